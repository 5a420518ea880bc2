"""`socontrol new`: a commented robot and problem to start from."""

from importlib import resources

from socontrol.cli.errors import USAGE, say

FILES = ("robot.yaml", "problem.yaml")


def write_starter(folder):
    """Exit code; refuses to overwrite, and then writes nothing at all."""
    standing = [folder / name for name in FILES if (folder / name).exists()]
    if standing:
        say(f"{standing[0]} exists and is not overwritten; name another folder")
        return USAGE
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in FILES:
            text = resources.files("socontrol.cli").joinpath("starter", name).read_text(encoding="utf-8")
            with (folder / name).open("x", encoding="utf-8") as stream:
                stream.write(text)
            print(folder / name)
    except OSError as error:
        say(f"{folder}: cannot be written: {error.strerror or error}")
        return USAGE
    say(f"next: socontrol solve {folder / FILES[1]}")
    return 0
