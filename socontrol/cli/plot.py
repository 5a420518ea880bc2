"""`socontrol plot`: the figures of a result folder, drawn again; on request the motion as a GIF."""

import sys

from socontrol.cli.errors import USAGE, say, told
from socontrol.files.result_file import load_result
from socontrol.files.yaml_reader import FileError, UnreadableFile


def draw_again(folder, output, gif=False):
    """Exit code; the paths of the figures, or with `gif` of the animation alone, on stdout."""
    try:
        result = load_result(folder)
        paths = _gif(folder, result, output) if gif else _figures(folder, result, output)
    except (FileError, UnreadableFile) as error:
        return told(error)
    except OSError as error:
        return told(UnreadableFile(f"{output}: cannot be written: {error.strerror or error}"))
    for path in paths or ():
        print(path)
    return USAGE if paths is None else 0


def _figures(folder, result, output):
    from socontrol.report.plots import draw

    paths = draw(result, output)
    if not paths:
        say(f"{folder}: the result has no numbers to draw ({result.status.outcome})")
    return paths


def _gif(folder, result, output):
    """[path] of the animation, None where there is none to make."""
    from socontrol.report.motion import MOVING
    from socontrol.report.motion_gif import write_gif

    kind = result.details.get("kind", "motion")
    if result.type not in MOVING or kind != "motion":
        what = result.type if kind == "motion" else f"{result.type} of a {kind}"
        say(f"{folder}: a result of type {what} does not move; --gif wants one of type {' or '.join(MOVING)}")
        return None
    output.mkdir(parents=True, exist_ok=True)
    path = output / "motion.gif"
    film = write_gif(result, path, _counting if sys.stderr.isatty() else None)
    if film is None:
        say(f"{folder}: the result has no numbers to draw ({result.status.outcome})")
        return None
    rate = "in real time" if film.speed == 1 else f"at {film.speed:g} x real time"
    say(f"{len(film.indices)} frames {rate}")
    return [path]


def _counting(done, total, sentence):
    """A line on the terminal that the next one overwrites, gone at the end."""
    end = "\r" + " " * 40 + "\r" if done == total else ""
    print(f"\rdrawing {sentence}", end=end, file=sys.stderr, flush=True)
