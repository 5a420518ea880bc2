"""Numbers in sentences: values in the unit people read, and what a limit would have to be."""

import numpy as np

SHOWN = (("Pa", 1e-3, "kPa"), ("m", 1e3, "mm"), ("N m", 1e3, "mN m"), ("rad", 180 / np.pi, "deg"))


def pretty(x, unit):
    """`25.1 kPa`, `3.9 mm`: an SI value with four digits."""
    for base, factor, name in SHOWN:
        if unit == base:
            return f"{x * factor:.4g} {name}"
    return f"{x:.4g} {unit}" if unit != "1" else f"{x:.4g}"


def would_need(name, needed, limit, when=""):
    """`c2 would need 63 N, its limit is 50 N`; needed, limit: texts with units."""
    return f"{name} would need {needed}{when}, its limit is {limit}"
