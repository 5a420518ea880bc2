"""Loops in words: what each bears, how well it is closed, and rows that hold nothing of their own."""

from socontrol.mechanics.loads import Wrench
from socontrol.report.columns import columns, say
from socontrol.report.units import number, quiet, readable

NOISE = 1e-10  # of the largest force, or of that force at the robot's length: less is rounding


def loops(result, console):
    """Table of forces and moments, in the joint frame of `b`, on what stands on `a`."""
    found = {k.removeprefix("loops."): v.value for k, v in result.values.items() if k.startswith("loops.")}
    if not found:
        return
    forces, moments = ([x for row in found.values() for x in row[part]] for part in (slice(3, 6), slice(3)))
    force, moment = _sizes(result, forces, moments)
    shown = []
    for rows, unit in ((quiet(forces, NOISE, force), "N"), (quiet(moments, NOISE, moment), "N m")):
        one, unit = readable(unit, *rows)
        shown.append(([number(x / one) for x in rows], unit))
    rows = [[(name, "bold"), *shown[0][0][3 * k : 3 * k + 3], *shown[1][0][3 * k : 3 * k + 3]]
            for k, name in enumerate(found)]  # fmt: skip
    heads = [f"{'FM'[kind]}{axis} [{shown[kind][1]}]>" for kind in range(2) for axis in "xyz"]
    columns(console, ["loop, on a by b", *heads], rows)
    if "loops" in result.residuals:
        say(console, "loops", f"recomputed, open by {result.residuals['loops'].value:.1e} m or rad at the most")
    redundant = result.details.get("redundant_rows") or {}
    if redundant:
        told = ", ".join(f"{count} of {name}" for name, count in redundant.items())
        say(console, "", f"Rows that hold nothing of their own (as across a plane): {told}; the least forces are told.")


def _sizes(result, forces, moments):
    """(force [N], moment [N m]) of the largest of loops and loads; moments are forces at the robot's length."""
    if result.question is None:
        return 0.0, 0.0
    robot = result.question.loaded
    loads = (load for load in (robot.description.loads or {}).values() if isinstance(load, Wrench))
    found = [[forces, moments], *([load.force, load.moment] for load in loads)]
    force, moment = (max(abs(x) for row in found for x in row[k] if isinstance(x, int | float)) for k in range(2))
    force = max(force, moment / robot.length)
    return force, force * robot.length
