"""`socontrol plot RESULT --csv FILE`: a planned motion as comma-separated text, as stored or at any rate."""

from dataclasses import replace

import numpy as np

from socontrol.cli.errors import USAGE, say, told
from socontrol.cli.plan_flags import BadFlag, as_number
from socontrol.cli.writing import write_whole
from socontrol.files.result_file import load_result
from socontrol.files.yaml_reader import FileError, UnreadableFile
from socontrol.quantities import Unit

MOST_ROWS = 200_000
STEP = Unit("s", lower=0.0, exclusive=True)


def write_table(folder, path, every=None):
    """Exit code; `every`: text of the time between rows, those that are stored without it."""
    try:
        result = load_result(folder)
        write_whole(path, _table(folder, result, every))
    except BadFlag as error:
        say(error)
        return USAGE
    except (FileError, UnreadableFile) as error:
        return told(error)
    print(path)
    return 0


def _table(folder, result, every):
    if result.type != "trajectory":
        raise BadFlag(f"{folder}: a result of type {result.type} is no plan; --csv wants one of type trajectory")
    if "t" not in result.arrays:
        raise BadFlag(f"{folder}: the result has no numbers to write ({result.status.outcome})")
    from socontrol.programs.plans.plan_answer import resampled
    from socontrol.report.plan_csv import table

    if every:
        result = replace(result, arrays=resampled(result, _times(result.arrays["t"], every)))
    return table(result)


def _times(stored, every):
    """Times from the first to the last stored one, both included."""
    try:
        step = STEP.read(as_number(every, f"--every {every}"))
    except ValueError as error:
        raise BadFlag(f"--every {every}: {error}") from None
    first, last = float(stored[0]), float(stored[-1])
    if (last - first) / step > MOST_ROWS:
        raise BadFlag(f"--every {every}: more than {MOST_ROWS} rows; take a longer time")
    count = int(np.ceil((last - first) / step * (1 - 1e-12)))
    return np.minimum(first + np.arange(count + 1) * step, last)
