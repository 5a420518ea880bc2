"""`socontrol plot`: the figures of a result folder, drawn again."""

from socontrol.cli.errors import say, told
from socontrol.files.result_file import load_result
from socontrol.files.yaml_reader import FileError, UnreadableFile


def draw_again(folder, output):
    """Exit code; the paths of the figures on stdout."""
    from socontrol.report.plots import draw

    try:
        result = load_result(folder)
        paths = draw(result, output)
    except (FileError, UnreadableFile) as error:
        return told(error)
    except OSError as error:
        return told(UnreadableFile(f"{output}: cannot be written: {error.strerror or error}"))
    for path in paths:
        print(path)
    if not paths:
        say(f"{folder}: the result has no numbers to draw ({result.status.outcome})")
    return 0
