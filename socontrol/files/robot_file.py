"""Robot files: YAML or a mapping in, a Robot out."""

from socontrol.files.loader import Document, override, read_yaml, validate
from socontrol.mechanics.robot import Description, Robot


def load_robot(path, overrides=()):
    """Robot of a YAML file; `overrides`: texts `a.b=VALUE`.

    Raises UnreadableFile, or FileError with one line `file:line: path: what, allowed, nearest fix`.
    """
    document = read_yaml(path)
    for text in overrides:
        document = override(document, text)
    return robot_of(document)


def robot(mapping):
    """Robot of a mapping with the keys of a robot file; raises FileError without file and line."""
    return robot_of(Document(mapping))


def robot_of(document, path=()):
    """Robot of (a part of) a document."""
    data = document.data
    for key in path:
        data = data[key]
    return Robot(validate(Description, data, document, path))
