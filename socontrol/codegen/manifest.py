"""manifest.json of a folder of C code: written with a hash of itself, read only where nothing was changed since."""

import hashlib
import json
from pathlib import Path

MANIFEST = "manifest.json"
SCHEMA_VERSION = 1
SEAL = "manifest_sha256"  # of the manifest's other keys
ODD = (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError)  # what damaged files raise


def sha256(text):
    """Hash of a text."""
    return hashlib.sha256(text.encode()).hexdigest()


def sealed(content):
    """The content of a manifest with the hash of itself."""
    return {**content, SEAL: _seal(content)}


def _seal(content):
    return sha256(json.dumps({key: value for key, value in content.items() if key != SEAL}, sort_keys=True))


def opened(folder):
    """(manifest, header, source) of a folder that `socontrol codegen` wrote.

    Raises ValueError for another folder, and for one whose manifest, header or source was changed since.
    """
    folder = Path(folder)
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if manifest["generator"] != "socontrol":
            raise LookupError("generator")
        version, changed = manifest["schema_version"], manifest.get(SEAL) != _seal(manifest)
        names = [f"{manifest['prefix']}{end}" for end in (".h", ".c")]
        texts = [(folder / name).read_text(encoding="utf-8") for name in names]
        files = manifest["files"]
        wrong = [MANIFEST] * changed + [n for n, text in zip(names, texts, strict=True) if files[n] != sha256(text)]
    except ODD as error:
        raise ValueError(f"{folder}: no folder of socontrol codegen ({type(error).__name__}: {error})") from None
    if version != SCHEMA_VERSION:
        raise ValueError(
            f"{folder}: {MANIFEST} has schema_version {version!r:.40}, {SCHEMA_VERSION} is wanted; generate it again"
        )
    if wrong:
        raise ValueError(f"{folder}: '{wrong[0]}' was changed since it was generated; generate the folder again")
    return manifest, *texts
