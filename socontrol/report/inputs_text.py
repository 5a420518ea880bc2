"""The table of inputs: value or range, limits, and a bar that shows where between them."""

from dataclasses import replace

import numpy as np

from socontrol.programs.result import Value
from socontrol.report.columns import columns
from socontrol.report.units import fixed, number, readable

BAR = 10  # characters
SEEN = 0.005  # of the limit: less reads as 0 %


def _limits(result):
    """(lower [m], upper [m]) in SI: the question's; the robot knows none without it."""
    if result.question is None:
        return None
    return result.question.input_limits()


def input_values(result):
    """[(name, SI value, unit)]."""
    return [
        (key.removeprefix("inputs."), v.value, v.unit) for key, v in result.values.items() if key.startswith("inputs.")
    ]


def inputs_table(result, console, on_path, idle=()):
    """Print the inputs, on a path their ranges; nothing without any. `idle`: names of slack cables."""
    values = input_values(result)
    if not values:
        return
    lower, upper = _limits(result) or ([-np.inf] * len(values), [np.inf] * len(values))
    path = np.asarray(result.arrays.get("path.u", ()))
    ranges = on_path and len(path)
    scales, rows = _scales(values, lower, upper), []
    for k, (name, value, unit) in enumerate(values):
        one, shown = readable(unit, scales[unit])
        low, high = (path[:, k].min(), path[:, k].max()) if ranges else (value, value)
        numbers = [fixed(x / one, scales[unit] / one) for x in ((low, high) if ranges else (value,))]
        rows.append(
            [
                (name, "bold"),
                *numbers,
                shown,
                _span(lower[k], upper[k], one, shown),
                "slack" if name in idle else _bar(console, low, high, lower[k], upper[k]),
            ]
        )
    columns(console, ["input", *(["least>", "most>"] if ranges else ["value>"]), "", "limits", ""], rows)


def ranges_table(result, console, u):
    """Print the ranges of inputs u [K x m] and where they stand within their limits."""
    robot = result.question.robot
    if not robot.m or not len(u):
        return
    u = np.reshape(u, (-1, robot.m))
    largest = zip(robot.inputs, np.max(np.abs(u), axis=0), robot.input_units, strict=True)
    values = {f"inputs.{name}": Value(float(x), unit) for name, x, unit in largest}
    inputs_table(replace(result, values=values, arrays={"path.u": u}), console, on_path=True)


def _scales(rows, lower, upper):
    """Largest value or limit of all inputs of a unit, so that they read in one unit."""
    scales = {}
    for (_, value, unit), *ends in zip(rows, lower, upper, strict=True):
        finite = [abs(x) for x in (value, *ends) if np.isfinite(x)]
        scales[unit] = max(scales.get(unit, 0.0), *finite)
    return scales


def _span(lower, upper, one, unit):
    low, high = (number(x / one) for x in (lower, upper))
    if np.isfinite(lower) and np.isfinite(upper):
        return f"{low} to {high} {unit}"
    if np.isfinite(upper):
        return f"at most {high} {unit}"
    return f"at least {low} {unit}" if np.isfinite(lower) else "none"


def _bar(console, low, high, lower, upper):
    """Where the value (or its range) stands between its limits: a bar, and its share of the limit."""
    if not np.isfinite(upper - lower) or upper <= lower:
        return ""
    full, empty = ("#", ".") if console.options.ascii_only else ("\u2588", "\u2591")
    signed = lower < 0 < upper
    size = BAR // 2 if signed else BAR
    shares = [(x / upper if x >= 0 else -x / lower) if signed else (x - lower) / (upper - lower) for x in (low, high)]
    told = [f"{100 * s:.0f}".replace("-0", "0") for s in shares]
    if signed:
        left, right = (_blocks(s, size) for s in (-shares[0], shares[1]))
        bar = empty * (size - left) + full * left + "|" + full * right + empty * (size - right)
    else:
        last = _blocks(shares[1], size)
        first = 0 if low == high else max(0, min(int(round(size * min(1.0, shares[0]))), last - 1))
        bar = empty * first + full * (last - first) + empty * (size - last)
    return f"{bar} {' to '.join(dict.fromkeys(told))} %"


def _blocks(share, size):
    """Full ones of `size` characters: at least one for what does not read as 0 %."""
    return max(int(round(size * float(np.clip(share, 0, 1)))), int(share >= SEEN))
