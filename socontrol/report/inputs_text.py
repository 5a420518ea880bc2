"""The table of inputs: value or range, limits, and a bar that shows where between them."""

import numpy as np

from socontrol.report.columns import columns
from socontrol.report.units import fixed, number, readable

BAR = 10  # characters


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


def inputs_table(result, console, on_path):
    """Print the inputs, on a path their ranges; nothing without any."""
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
                _bar(console, low, high, lower[k], upper[k]),
            ]
        )
    columns(console, ["input", *(["from>", "to>"] if ranges else ["value>"]), "", "limits", ""], rows)


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
    shares = [(x / upper if x >= 0 else -x / lower) if signed else (x - lower) / (upper - lower) for x in (low, high)]
    percent = " to ".join(dict.fromkeys(f"{100 * s:.0f}".replace("-0", "0") for s in shares))
    if signed:
        half = BAR // 2
        left, right = (int(round(half * max(0.0, s))) for s in (-shares[0], shares[1]))
        bar = empty * (half - left) + full * left + "|" + full * right + empty * (half - right)
    else:
        first, last = (int(round(BAR * float(np.clip(s, 0, 1)))) for s in shares)
        first = 0 if low == high else min(first, BAR - 1)
        last = last if low == high else max(last, first + 1)
        bar = empty * first + full * (last - first) + empty * (BAR - last)
    return f"{bar} {percent} %"
