"""Draw the pictures of the README into problems/gallery: `python tests/benchmarks/gallery.py [FOLDER]`.

- figures of shipped problems, the moving ones included;
- the error of constant-strain sections against their number, for a cantilever with a dead load at its tip.
"""

import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np

import socontrol as so
from socontrol.mechanics.loads import Wrench
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.materials import Linear
from socontrol.model.rods import Rod
from socontrol.model.sections import Circle
from socontrol.programs.postures.statics import Statics
from socontrol.report import style
from socontrol.report.plots import draw, save

ROOT = Path(__file__).parents[2]
GALLERY = ROOT / "problems" / "gallery"
# Tip (x, z) [m] by the load P L^2 / EI, dead force -z at the end of a cantilever: L = 1 m, E = 10 MPa,
# nu = 0.3, radius 10 mm. Chebyshev collocation of the strong form with extension and shear, to 1e-8 of L.
ELASTICA = {
    1.0: (0.9435569542819898, -0.3017778953521505),
    5.0: (0.6123354856053704, -0.7139748823646199),
    10.0: (0.4449578135578038, -0.8109393581866664),
}
SECTIONS = (1, 2, 4, 8, 16, 32)


def cantilever(load, sections):
    """Distance [m] of the tip from the reference for one load and number of sections."""
    inertia = np.pi * 0.01**4 / 4
    rod = Rod(
        length=1.0,
        strains="simo_reissner",
        sections=sections,
        cross_section=Circle(radius=0.01),
        material=Linear(young_modulus=1e7, poisson_ratio=0.3, density=1000.0),
    )
    robot = Robot(Description(segments={"rod": rod}, gravity=(0.0, 0.0, 0.0)))
    force = Wrench(on="rod", force=(0.0, 0.0, -load * 1e7 * inertia))
    result = Statics(robot=robot, loads={"tip": force}, discretisation=False).solve().require()
    x, _, z = result["rod.position"]
    return float(np.hypot(x - ELASTICA[load][0], z - ELASTICA[load][1]))


def convergence(path):
    """Figure of the error against the number of sections; returns {load: fitted slope}."""
    figure, slopes = style.new_figure(5.6, 3.9), {}
    ax = figure.subplots()
    count = np.array(SECTIONS)
    for k, load in enumerate(ELASTICA):
        errors = np.array([cantilever(load, n) for n in SECTIONS])
        slopes[load] = float(np.polyfit(np.log(count[2:]), np.log(errors[2:]), 1)[0])
        label = f"$PL^2/EI$ = {load:g}: slope {slopes[load]:.2f}"
        ax.loglog(count, 100 * errors, "os^"[k] + "-", color=style.series(k)[0], lw=1.4, ms=5, label=label)
        print(f"cantilever, P L^2 / EI = {load:g}: errors / L", " ".join(f"{e:.2e}" for e in errors))
    ax.loglog(count[[1, -1]], 1.2 * (count[[1, -1]] / 2.0) ** -2.0, "k--", lw=0.9, label="second order")
    ax.set_xlabel("sections of constant strain [1]")
    ax.set_ylabel("error of the tip over the length [%]")
    ax.set_xticks(count, [str(n) for n in count])
    ax.minorticks_off()
    ax.grid(color="#e6e9ed", lw=0.5)
    ax.legend(title="dead load at the tip")
    save(figure, path)
    return slopes


PICTURES = {  # problem file: those of its figures to keep
    "stiff_flop_reach": ("robot", "inputs"),
    "stiff_flop_mini_circle": ("robot", "path"),
    "stiff_flop_unreachable": ("robot",),
    "stiff_flop_measured": ("fit",),
    "lophotricus_straight": ("shapes", "energies"),
    "octopus_arm_release": ("shapes",),
    "stiff_flop_sweep": ("path",),
    "octopus_three_motors": ("histories",),
    "octopus_brace": ("robot",),
    "octopus_figure_eight": ("robot", "strips"),
    "tip_tracking": ("strips", "path"),
    "finray_press": ("robot",),
    "finray_buckling": ("branches",),
    "parallel_soft_platform": ("robot",),
}


def main(folder=GALLERY):
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, kept in PICTURES.items():
        result = so.solve(so.load_problem(ROOT / "problems" / f"{name}.yaml"))
        print(f"{result.name}: {result.status.message}")
        with tempfile.TemporaryDirectory() as temporary:
            for path in (p for p in draw(result, temporary) if p.stem in kept):
                (folder / f"{result.name}_{path.name}").write_bytes(path.read_bytes())
    with mpl.rc_context(style.STYLE):
        for load, slope in convergence(folder / "error_against_sections.png").items():
            print(f"fitted slope at P L^2 / EI = {load:g}: {slope:.3f}")


if __name__ == "__main__":
    main(*sys.argv[1:2])
