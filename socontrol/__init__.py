"""socontrol: inverse statics of robots made of rigid links, soft rods or both."""

import importlib

__version__ = "0.1.0"

_HOMES = {
    "load_robot": "socontrol.files.robot_file",
    "robot": "socontrol.files.robot_file",
    "load_problem": "socontrol.files.problem_file",
    "problem": "socontrol.files.problem_file",
    "solve": "socontrol.programs.questions",
    "ellipsoids": "socontrol.programs.postures.ellipsoids",
    "load_result": "socontrol.files.result_file",
    "codegen": "socontrol.codegen",
    "load_compiled": "socontrol.codegen.loaded",
    "Robot": "socontrol.mechanics.robot",
    "Result": "socontrol.programs.result",
    "NotSolved": "socontrol.programs.result",
    "FileError": "socontrol.files.loader",
}
__all__ = sorted(_HOMES)


def __getattr__(name):
    """Public names load their module when first used, so that importing socontrol stays fast."""
    if name not in _HOMES:
        raise AttributeError(f"module 'socontrol' has no attribute '{name}'")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__():
    return [*__all__, "__version__"]
