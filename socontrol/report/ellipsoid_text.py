"""Ellipsoids in words: semi-axes, longest first, and where the first one points."""

import numpy as np

from socontrol.quantities import joined
from socontrol.report.columns import columns, line, say
from socontrol.report.units import fixed, number, readable

WHAT = {  # kind: what its semi-axes are
    "kinematic": "motion for a change of the coordinates of size 1",
    "compliance": "motion at rest for a force, or a moment, of size 1",
    "actuation": "motion at rest for changes of the inputs, over their limits, of size 1, by the slope there",
    "force": "force, or moment, for forces of the coordinates of size 1",
}


def of_kind(result, kind, part):
    """(semi-axes [3], directions [3 x 3] a row each, unit); NaN of a loaded result is infinite again."""
    axes, directions = (result.values[f"ellipsoid.{kind}.{part}.{key}"] for key in ("axes", "directions"))
    sizes = np.array(axes.value, dtype=float)
    return np.where(np.isfinite(sizes), sizes, np.inf), np.array(directions.value, dtype=float), axes.unit


def place(told):
    """`the end of arm`, `arm at 0.5`."""
    return f"the end of {told['on']}" if told["at"] == 1 else f"{told['on']} at {number(told['at'])}"


def table(result, console):
    """The ellipsoids of a result, a row each; nothing where there are none."""
    told = result.details.get("ellipsoids")
    if not told:
        return
    rows = [_row(result, kind, part) for kind in told["kinds"] for part in ("translation", "rotation")]
    line(console, f"ellipsoids of {place(told)}, world axes")
    if rows:
        columns(console, ["kind", "of", "semi-axes>", ">", ">", "", "longest along x, y, z"], rows)
    for kind in told["kinds"]:
        say(console, kind, WHAT[kind])
    if told.get("far"):
        far = joined(told["far"], "and")
        say(console, "", f"Linear extrapolation: the robot does not go {far} from here along a straight line.")
    for kind, why in told["notes"].items():
        say(console, kind, f"none: {why}", "yellow")
    counted = [kind for kind in ("kinematic", "force") if kind in told["kinds"]]
    if counted and result.question is not None and any(p.is_rod for p in result.question.robot.tree.pieces):
        counted = " and ".join(counted)
        say(console, "", f"Strains of rods count as coordinates ({counted}): sizes change with the number of sections.")
    line(console, "")


def _row(result, kind, part):
    axes, directions, unit = of_kind(result, kind, part)
    finite = axes[np.isfinite(axes)]
    one, name = readable(unit, *finite)
    sizes = ["rigid" if np.isinf(x) else number(x / one, 4) for x in axes]
    longest = "  ".join(f"{fixed(x, 1.0, 4):>6}" for x in directions[0]) if np.any(axes > 0) else "does not move"
    return [(kind, "bold"), part, *sizes, name, longest]
