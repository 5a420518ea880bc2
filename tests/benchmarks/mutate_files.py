"""Damage the shipped files N times (default 10000) and count what `socontrol check` makes of it.

python tests/benchmarks/mutate_files.py [N] [FIRST_SEED]
"""

import sys
import tempfile
import time
import warnings
from collections import defaultdict
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent))
from mutations import Remembered, bases, judged, mutant  # it stands beside this folder


def main(count=10_000, first=0):
    """Print the table; exit code 1 if a file was crashed on or too much harm went unnamed."""
    warnings.filterwarnings("ignore", category=RuntimeWarning)
    rows, crashed, slowest = defaultdict(lambda: [0] * 6), [], (0.0, None)
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        Remembered(patch)
        shipped = bases()
        for seed in range(first, first + count):
            start = time.perf_counter()
            v = judged(mutant(shipped, seed), Path(folder))
            slowest = max(slowest, (time.perf_counter() - start, seed))
            row = rows[v.mutant.kind]
            harmful = v.mutant.harmful
            columns = (True, v.code == 0, v.code == 3, v.code not in (0, 3), harmful, harmful and v.named)
            for k, counted in enumerate(columns):
                row[k] += counted
            if v.code not in (0, 3):
                crashed.append((seed, v.mutant.base.name, v.mutant.kind, v.mutant.path, v.lines[0]))
    heads = ("mutation", "files", "exit 0", "exit 3", "other", "harmful", "named on its line")
    print("  ".join(f"{head:>{max(len(head), 8)}}" for head in heads))
    total = [sum(column) for column in zip(*rows.values(), strict=True)]
    for kind, row in [*sorted(rows.items()), ("all", total)]:
        share = f" {row[5] / row[4]:.1%}" if row[4] else ""
        cells = [kind, *map(str, row[:5]), f"{row[5]}{share}"]
        print("  ".join(f"{cell:>{max(len(head), 8)}}" for cell, head in zip(cells, heads, strict=True)))
    print(f"{time.perf_counter() - began:.0f} s; slowest {slowest[0]:.2f} s, seed {slowest[1]}")
    for crash in crashed:
        print("crash:", *crash)
    return 1 if crashed or total[5] < 0.9 * total[4] else 0


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:])))
