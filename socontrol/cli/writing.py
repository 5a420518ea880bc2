"""Single text files that the command line writes, each whole or not at all."""

import os

from socontrol.files.yaml_reader import UnreadableFile, one_line


def write_whole(path, text):
    """Put the text in the place of a file, written beside it first; raises UnreadableFile."""
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        try:
            part.write_text(text, encoding="utf-8")
            os.replace(part, path)
        finally:
            part.unlink(missing_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise UnreadableFile(one_line(f"{path}: cannot be written: {reason}")) from None
