"""A continuation in words: critical points, the branches and where they end, and how far all this can be trusted."""

from itertools import groupby

import numpy as np
from rich.text import Text

from socontrol.programs.equilibria.stability import called_along
from socontrol.quantities import joined
from socontrol.report.columns import columns, line, say
from socontrol.report.said import headline
from socontrol.report.units import miss, number, readable, with_unit

ENDS = {  # why a branch ends
    "end": "end of the range",
    "back": "as far to the other side",
    "points": "stopped: `points` is reached",
    "closed": "back where it began",
    "meets": "meets another branch",
    "strains": "stopped: a section would turn by more than 2 pi",
    "lost": "stopped: no next point was found",
}


def render(result, console, verbose=0):
    """Print the result of a continuation; `verbose` adds the residuals."""
    headline(result, console)
    if not result.details.get("branches"):
        return
    _critical(result, console)
    _branches(result, console)
    _trust(result, console, verbose)


def loads(result):
    """(numbers by which the parameter becomes a load, its unit, what it is): of the force of a single load, else of a
    factor."""
    if forces := single(result):
        name, size, unit = forces[0]
        what = {"N": "force", "N m": "moment"}.get(unit, "acceleration")
        return size, unit, "gravity" if name == "gravity" else f"{what} {name}"
    return 1.0, result.details["unit"], result.details["varies"]


def single(result):
    """[(load, size, unit)], the force and the moment of the load that varies; empty where several vary."""
    forces = result.details["forces"]
    return forces if len({name for name, _, _ in forces}) == 1 else []


def standing(result, k):
    """What the points of branch k are called: stable, marginal, unstable."""
    row = result.details["branches"][k]
    leaves = [] if row["from"] is None else [0]
    return called_along(result.arrays[f"branch.{k}.smallest_eigenvalue"], [*leaves, *(at for _, at in row["critical"])])


def place_of(result):
    """The place that is watched: `end of rod`, `rod at 0.5`."""
    watch = result.details["watch"]
    return f"end of {watch['on']}" if watch["at"] == 1 else f"{watch['on']} at {watch['at']:g}"


def told(result, mu):
    """The parameter as a load with its unit, `2.47 N`; a factor is a plain number."""
    size, unit, _ = loads(result)
    return _amount(mu * size, unit)


def _amount(x, unit):
    one, name = suited(unit, x or 1.0)
    return f"{number(x / one, 5)} {name}".rstrip()


def suited(unit, *values):
    """(value of one in SI, name) of the unit for loads; accelerations stay in m/s^2."""
    return (1.0, unit) if unit == "m/s^2" else readable(unit, *values)


def _critical(result, console):
    rows, forces, parts = [], result.details["forces"], single(result)
    for k, row in enumerate(result.details["critical"]):
        mu = result[f"critical.{k}"]
        given = number(mu, 6) if forces else told(result, mu)
        cells = [(f"critical.{k}", "bold"), row["kind"], f"branch {row['branch']}", given]
        cells += [_amount(mu * size, unit) for _, size, unit in parts]
        rows.append([*cells, f"{row['before']} -> {row['after']}", str(row["modes"])])
    heads = ["critical point", "kind", "on", f"{'factor' if forces else result.details['varies']}>"]
    heads += [f"{parts[0][0]}>", "its moment>"][: len(parts)] if parts else []
    if rows:
        columns(console, [*heads, "unstable motions", "modes"], rows)
    else:
        line(console, Text("No critical point.", style="dim"))
        line(console, "")


def _branches(result, console):
    rows = []
    for k, row in enumerate(result.details["branches"]):
        places = result.arrays[f"branch.{k}.watch"]
        start = result.arrays["branch.0.watch"][0]
        farthest = float(np.max(np.linalg.norm(places - start, axis=1)))
        come = "the beginning" if row["from"] is None else f"critical.{row['from']}"
        rows.append([(str(k), "bold"), come, _runs(standing(result, k)[1:]), told(result, result[f"branch.{k}.end"]),
                     ENDS[row["ended"]], with_unit(farthest, "m")])  # fmt: skip
    columns(console, ["branch", "from", "stability", "ends at>", "why", f"{place_of(result)} moves>"], rows)


def _runs(words):
    """`stable, unstable, stable` along a branch; of more changes each word once."""
    runs = [word for word, _ in groupby(words)]
    return ", ".join(runs) if len(runs) < 4 else f"{joined(list(dict.fromkeys(runs)), 'and')} in turn"


def _trust(result, console, verbose):
    found, details = result.residuals, result.details
    say(console, "forces", f"recomputed, unbalanced {found['force'].value:.1e} of the largest force at the most")
    if "critical" in found:
        told_of = f"recomputed, modes at critical points have {found['critical'].value:.1e} of the stiffness at rest"
        say(console, "stiffness", told_of)
    if "loops" in found:
        say(console, "loops", f"recomputed, open by {found['loops'].value:.1e} m or rad at the most")
    if redundant := details.get("redundant_rows"):
        each = ", ".join(f"{count} of {name}" for name, count in redundant.items())
        say(console, "", f"Rows that hold nothing of their own (as across a plane): {each}.")
    if "critical_load_change" in details:
        say(console, "sections", _sections(result))
    if verbose:
        say(console, "solver", f"unbalanced {miss(found['solver_force'].value, '1')} of the largest force")
    line(console, "")


def _sections(result):
    change = result.details["critical_load_change"]
    if change is None:
        return "with twice the sections stability is not lost nearby; use more sections"
    load = result["critical_load"]
    share = f", {number(100 * change / load, 2)} %" if load else ""
    what = "load" if loads(result)[1] != "1" else "factor"
    return f"twice as many move the critical {what} by {told(result, change)}{share}"
