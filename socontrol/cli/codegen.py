"""`socontrol codegen`: a robot or problem file in, a folder of C code out."""

from socontrol.cli.console import console
from socontrol.cli.errors import BAD_FILE, INTERRUPTED, USAGE, interrupted, say, told
from socontrol.cli.interrupts import Interrupts
from socontrol.codegen.budget import TooLarge
from socontrol.codegen.catalogue import BadRequest
from socontrol.codegen.folder import write
from socontrol.files.yaml_reader import FileError, UnreadableFile
from socontrol.native.c_source import NotExportable
from socontrol.quantities import Bad

LIMIT = 5  # exit code of what the user can allow with a flag


def export(path, output, functions, real, force, overrides=()):
    """Exit code; says what was written on stdout, and what was left out on stderr."""
    with Interrupts() as stop:
        try:
            return _export(path, output, functions, real, force, overrides)
        except (Exception, KeyboardInterrupt) as error:
            if not (stop.seen or interrupted(error)):
                raise
            say(f"{path}: interrupted")
            return INTERRUPTED


def _export(path, output, functions, real, force, overrides):
    wanted = None if functions is None else [text for text in functions.split(",") if text.strip()]
    try:
        written = write(path, output, wanted, real=real, force=force, overrides=overrides)
    except (FileError, UnreadableFile) as error:
        return told(error)
    except BadRequest as error:
        say(f"{path}: {error}", own=False)
        return USAGE
    except TooLarge as error:
        say(f"{path}: {error}", own=False)
        return LIMIT
    except (Bad, NotExportable) as error:
        key = getattr(error, "key", "")
        say(f"{path}: {f'{key}: ' * bool(key)}{error}", own=False)
        return BAD_FILE
    for name, why in written.too_large.items():
        say(f"left out: {name}: {why}")
    show(written.manifest, console())
    if unknown := not_measured(written.manifest):
        say(f"not measured, for lack of a C compiler that works and knows -fstack-usage: {' and '.join(unknown)}")
    say(f"{output}{'' if str(output).endswith('/') else '/'} written")
    return 0


def not_measured(manifest):
    """What the manifest leaves open because this machine has no compiler that tells it."""
    error = manifest["real"] == "float" and manifest["functions"] and not manifest["float_error"]
    return ["the stack"] * (manifest["stack_bytes"] is None) + ["the error of single precision"] * bool(error)


def show(manifest, out):
    """One line a function, and what the whole takes."""
    prefix, real, errors = manifest["prefix"], manifest["real"], manifest["float_error"] or {}
    out.print(f"{prefix}.h, {prefix}.c: {manifest['c_bytes'] / 1e3:.0f} kB of C99, {real}", soft_wrap=True)
    for row in manifest["functions"]:
        given = ", ".join(f"{a['name']}[{a['size']}]" for a in row["arguments"] if a["size"])
        sizes = {r["name"]: r["rows"] * r["columns"] for r in row["results"]}
        found = ", ".join(f"{name}[{size}]" for name, size in sizes.items() if size)
        error = errors.get(row["name"].removeprefix(f"{prefix}_"))
        told = f"  {row['operations']} operations" + (f", error {error:.1e}" if error is not None else "")
        out.print(f"  {row['name']}({given}) -> {found}{told}", soft_wrap=True)
    stack = f", at most {manifest['stack_bytes']} bytes of stack" if manifest["stack_bytes"] else ""
    seconds = f"about {max(1, manifest['compile_seconds']):.0f} s of gcc -O1"
    out.print(f"{manifest['static_bytes']} bytes of static memory{stack}, no heap; {seconds}", soft_wrap=True)
