"""Facts and columns on a console, aligned by hand: the same on a terminal, in a file and in a README."""

import textwrap

from rich.text import Text

INDENT = 13  # of a fact behind its label


def line(console, text):
    console.print(text, soft_wrap=True, highlight=False)


def say(console, label, sentence, style=""):
    """One fact: a short label, then a sentence, wrapped under itself."""
    width = max(20, console.width - INDENT)
    lines = textwrap.wrap(sentence, width, break_long_words=False, break_on_hyphens=False) or [""]
    for k, part in enumerate(lines):
        text = Text(f"{label if k == 0 else '':<{INDENT}}", style="dim")
        line(console, text.append(part, style=f"not dim {style}"))


def columns(console, headers, rows):
    """Aligned columns; a header that ends in `>` aligns to the right. Cells: text or (text, style)."""
    cells = [[cell if isinstance(cell, tuple) else (cell, "") for cell in row] for row in rows]
    right = [header.endswith(">") for header in headers]
    titles = [header.removesuffix(">") for header in headers]
    widths = [max(len(t), *(len(row[k][0]) for row in cells)) for k, t in enumerate(titles)]
    for row, tone in ([([(t, "") for t in titles], "dim")] if any(titles) else []) + [(row, "") for row in cells]:
        text = Text()
        for k, (cell, style) in enumerate(row):
            text.append(f"{cell:>{widths[k]}}" if right[k] else f"{cell:<{widths[k]}}", style=tone or style)
            text.append("  " if k + 1 < len(row) else "")
        text.rstrip()
        line(console, text)
    line(console, "")
