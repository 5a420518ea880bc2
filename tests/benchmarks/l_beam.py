"""The clamped L of two soft bars: its largest displacement with ever more sections, with two torsion constants.

An independent strong-form solution, shear included, gives 12.07 cm with b^4/6 and 12.48 cm with Saint-Venant's;
SoRoSim's paper prints 12.98 cm, and 13.265 cm by ANSYS, for the same sizes, which neither explains.

    python tests/benchmarks/l_beam.py [SECTIONS ...]
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from chains import L_BEAM_TORSION, l_beam_displacement

KNOWN = {"b^4/6": 12.07, "Saint-Venant": 12.48}  # cm


def main(counts=(2, 4, 8, 16)):
    for name, torsion in L_BEAM_TORSION.items():
        found = []
        for count in counts:
            began = time.perf_counter()
            found.append(100 * l_beam_displacement(count, torsion))
            print(f"{name}: {count:3d} sections a bar, {found[-1]:.4f} cm, {time.perf_counter() - began:.1f} s")
        limit = found[-1] + (found[-1] - found[-2]) / ((counts[-1] / counts[-2]) ** 2 - 1)
        errors = np.abs(limit - np.array(found[:-1]))
        orders = -np.diff(np.log(errors)) / np.diff(np.log(counts[:-1]))
        told = ", ".join(f"{error:.4f}" for error in errors)
        print(f"{name}: extrapolated {limit:.3f} cm ({KNOWN[name]} known), errors {told} cm,"
              f" orders {', '.join(f'{x:.2f}' for x in orders)}")  # fmt: skip


if __name__ == "__main__":
    main(*([tuple(map(int, sys.argv[1:]))] if sys.argv[1:] else []))
