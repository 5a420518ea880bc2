"""Loops in words: what each bears, how well it is closed, and rows that hold nothing of their own."""

from socontrol.report.columns import columns, say
from socontrol.report.units import number, quiet, readable


def loops(result, console):
    """Table of forces and moments, in the joint frame of `b`, on what stands on `a`."""
    found = {k.removeprefix("loops."): v.value for k, v in result.values.items() if k.startswith("loops.")}
    if not found:
        return
    forces, moments = ([x for row in found.values() for x in row[part]] for part in (slice(3, 6), slice(3)))
    shown = []
    for rows, unit in ((quiet(forces), "N"), (quiet(moments), "N m")):
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
