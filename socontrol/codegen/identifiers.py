"""Legal and distinct C identifiers of the names in robot and problem files."""

import re
import unicodedata

LONGEST = 40  # characters of a prefix: names stay readable
FILES = "main selftest"  # files of a folder that are named so already
# Targets of CMake, and the library of <math.h>.
TARGETS = "all clean depend edit_cache example help install m package preinstall rebuild_cache test uninstall"
# Headers that NAME.h would hide from those who include them: of C, of POSIX, and what these include.
HEADERS = """
    assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign stdarg stdatomic
    stdbool stdbit stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath threads time uchar wchar wctype
    aio alloca byteswap cpio dirent dlfcn endian fcntl features fmtmsg fnmatch ftw getopt glob grp iconv langinfo
    libgen malloc memory mqueue ndbm netdb newlib nl_types paths poll pthread pwd reent regex sched search semaphore
    spawn strings stropts syslog tar termios trace ulimit unistd utime utmpx wordexp
"""
KEYWORDS = """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char char16_t char32_t char8_t class co_await
    co_return co_yield compl concept const const_cast consteval constexpr constinit continue decltype default delete do
    double dynamic_cast else enum explicit export extern false float for friend goto if inline int long mutable
    namespace new noexcept not not_eq nullptr operator or or_eq private protected public register reinterpret_cast
    requires restrict return short signed sizeof static static_assert static_cast struct switch template this
    thread_local throw true try typedef typeid typename typeof typeof_unqual union unsigned using virtual void volatile
    wchar_t while xor xor_eq
"""
DEVICES = "aux con nul prn"  # no names of files on Windows
INSIDE = {"casadi", "cholesky", "eval", "lu", "qp", "sqp", "wanted"}  # first words of names in the C files
RESERVED = INSIDE.union(*(words.split() for words in (FILES, TARGETS, HEADERS, KEYWORDS, DEVICES)))


def identifier(text):
    """Lower-case letters, digits and underscores of a name, '' where nothing is left."""
    plain = unicodedata.normalize("NFKD", str(text)).encode("ascii", "ignore").decode().lower()
    return re.sub(r"_+", "_", re.sub(r"[^a-z0-9]", "_", plain)).strip("_")


def prefix(name):
    """The word that every C name of a folder begins with, and its files are named by."""
    found = identifier(name)[:LONGEST].strip("_")
    if not found:
        return "robot"
    if found in RESERVED:
        return f"{found}_robot"
    return f"robot_{found}" if found[0].isdigit() or found.split("_")[0] in INSIDE else found


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
