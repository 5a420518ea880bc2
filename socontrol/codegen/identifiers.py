"""Legal and distinct C identifiers of the names in robot and problem files."""

import re
import unicodedata

LONGEST = 40  # characters of a prefix: names stay readable
FILES = {"main", "selftest"}  # files of a folder that are named so already
TARGETS = {"all", "clean", "help", "install", "package", "test", "edit_cache", "rebuild_cache", "example"}  # of CMake


def identifier(text):
    """Lower-case letters, digits and underscores of a name, '' where nothing is left."""
    plain = unicodedata.normalize("NFKD", str(text)).encode("ascii", "ignore").decode().lower()
    return re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", plain)).strip("_")


def prefix(name):
    """The word that every C name of a folder begins with, and its files are named by."""
    found = identifier(name)[:LONGEST].strip("_")
    if not found:
        return "robot"
    if found[0].isdigit():
        found = f"robot_{found}"
    return f"{found}_robot" if found in FILES | TARGETS else found


def distinct(names):
    """The names with _2, _3 ... after those that were there before."""
    taken, found = set(), []
    for name in names:
        given, k = name, 2
        while name in taken:
            name, k = f"{given}_{k}", k + 1
        taken.add(name)
        found.append(name)
    return found
