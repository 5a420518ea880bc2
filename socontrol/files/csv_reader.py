"""Comma-separated files that a problem file names: one head line, numbers below it.

Mistakes are FileErrors at the key of the problem file that names the file.
"""

import csv
import itertools
import math
import os
from dataclasses import dataclass
from pathlib import Path

from socontrol.programs.motions.signals import LONGEST
from socontrol.quantities import joined, show


@dataclass(frozen=True)
class Sheet:
    """A file as it was read: `heads` of its columns, `rows` (line, cells) without the empty ones.

    `refuse(sentence)`: the FileError of what is wrong in it.
    """

    file: str
    heads: list
    rows: list
    refuse: object

    def column(self, head):
        """Numbers of a column, all finite."""
        place, numbers = self.heads.index(head), []
        for line, cells in self.rows:
            try:
                number = float(cells[place])
            except (ValueError, IndexError):
                raise self.refuse(f"{self.file}:{line}: no number in column '{head}'") from None
            if not math.isfinite(number):
                raise self.refuse(f"{self.file}:{line}: {number} in column '{head}' is not a finite number")
            numbers.append(number)
        return numbers

    def times(self, head="t"):
        """Rising numbers of the column of the time."""
        if head not in self.heads:
            found = joined(self.heads, "and") if any(self.heads) else "none"
            raise self.refuse(f"'{self.file}' has no column '{head}' of the time; it has {found}")
        times = self.column(head)
        for k, (a, b) in enumerate(itertools.pairwise(times), start=1):
            if not a < b:
                line = self.rows[k][0]
                raise self.refuse(f"{self.file}:{line}: {b:g} s does not come after {a:g} s; times must rise")
        return times


def read_sheet(document, path, file, folder):
    """Sheet of the `file` that stands at a path of the document, relative to `folder`."""
    if not isinstance(file, str):
        raise document.error(path, f"{show(file)} is given; a path is wanted")
    try:
        if (folder / file).exists() and not (folder / file).is_file():
            raise ValueError
        with open(short(folder / file), newline="", encoding="utf-8-sig") as stream:
            rows = list(itertools.islice(enumerate(csv.reader(stream), start=1), LONGEST + 2))
    except (OSError, UnicodeDecodeError, csv.Error, ValueError) as error:
        why = getattr(error, "strerror", None) or "no comma-separated text"
        raise document.error(path, f"cannot read '{file}' beside this file: {why}") from error
    heads = [head.strip() for head in rows[0][1]] if rows else []
    filled = [(line, cells) for line, cells in rows[1:] if any(cell.strip() for cell in cells)]
    return Sheet(file, heads, filled, lambda sentence: document.error(path, sentence))


def short(path):
    """The path without detours over `..`, if that leads to the same file."""
    try:
        found = Path(os.path.normpath(path))
        return found if found.samefile(path) else path
    except (OSError, ValueError):
        return path
