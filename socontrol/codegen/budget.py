"""How large C code may become, and how long a compiler will take over it."""

from socontrol.native import c_source

LARGEST = 4_000_000  # bytes of C text
LONGEST = 120.0  # s of gcc -O1 over all of it
LONGEST_OWN = 40.0  # s over one function that nobody named


BYTES = 21.0  # of C text for one operation, what goes with it included
SPARE = ("coriolis", "momentum", "energy")  # what a controller misses least, first to go where nobody chose


class TooLarge(ValueError):
    """The code would be beyond a budget; the text names the largest function and what to do."""


def seconds(statements):
    """Time of gcc 12 -O1 on one core of a server over {definition: statements of straight-line code}.

    Measured on functions of 700 to 96,000 statements: 0.09, 0.27, 1.1, 3.2, 7.4, 10 and 92 s at 0.7, 2.3, 9.3, 14,
    20, 36 and 96 thousand; the quadratic part is register allocation.
    """
    return sum(1e-4 * n + 8e-9 * n**2 for n in statements.values())


def entry_seconds(code, name):
    """Time over one entry of a CSource, and what it alone reaches or shares."""
    return seconds(code.statements[name])


def total_seconds(code):
    """Time over the whole text: what entries share counts once."""
    every = {}
    for statements in code.statements.values():
        every.update(statements)
    return seconds(every)


def estimate(functions):
    """(bytes, s) of the C code of casadi Functions, before it is written; what they share counts once."""
    found = dict(enumerate(c_source.lengths(functions)))
    return BYTES * sum(found.values()), seconds(found)


def left_out(entries):
    """{Entry: how large} of what a folder that nobody chose is better off without."""
    found = {}
    for entry in entries:
        size, time = estimate([entry.function])
        if time > LONGEST_OWN and len(entries) > 1:
            found[entry] = size, time
    order = sorted(entries, key=lambda e: (_spared(e.wish.kind), -estimate([e.function])[1]))
    for entry in order[:-1]:
        size, time = estimate([e.function for e in entries if e not in found])
        if size <= LARGEST and time <= LONGEST:
            break
        found.setdefault(entry, estimate([entry.function]))
    told = "{:.1f} MB of C, about {:.0f} s of gcc; name it to have it"
    return {entry: told.format(size / 1e6, time) for entry, (size, time) in found.items()}


def _spared(kind):
    return SPARE.index(kind) if kind in SPARE else len(SPARE)


def largest(code):
    """C name of the entry that takes longest, and a sentence part on it."""
    name = max(code.statements, key=lambda n: (entry_seconds(code, n), code.bytes[n]))
    return name, f"{code.bytes[name] / 1e6:.1f} MB of C, about {entry_seconds(code, name):.0f} s of gcc"


def fits(code):
    """Whether the whole is within the budgets."""
    return len(code.text) <= LARGEST and total_seconds(code) <= LONGEST


def check(code, hint, text_of=str):
    """Raise TooLarge for code beyond a budget; `text_of`: how a user calls an entry."""
    if fits(code):
        return
    name, size = largest(code)
    raise TooLarge(
        f"the C code would be {len(code.text) / 1e6:.1f} MB (limit {LARGEST / 1e6:g}) and take about"
        f" {total_seconds(code):.0f} s of gcc (limit {LONGEST:g}); the largest function is '{text_of(name)}' ({size});"
        f" {hint}, or write it all the same with --force"
    )
