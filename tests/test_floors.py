"""Who may import whom: every module looks down only, whether it imports at the top or inside a function.

Floors stand top to bottom; a module imports modules of lower floors, or of its own folder where the folder is
listed as free inside (then cycles alone are forbidden). Neighbours on one floor do not import each other.
"""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent / "socontrol"
FLOORS = [  # a name ending in "/" is every other module of that folder
    ["cli/", "cli"],
    ["codegen/"],
    ["files/"],
    ["report/"],
    ["programs/questions"],
    ["programs/tensions/"],
    ["programs/plans/"],
    ["programs/postures/", "programs/motions/"],
    ["programs/looks/"],
    ["programs/equilibria/"],
    ["programs/question"],
    ["programs/nlp/"],
    ["programs/"],
    ["native/"],
    ["mechanics/functions"],
    ["mechanics/robot"],
    ["mechanics/floating", "mechanics/internal"],
    ["mechanics/closed"],
    ["mechanics/articulated", "mechanics/statics"],
    ["mechanics/loop_checks"],
    ["mechanics/loops"],
    ["mechanics/loop_slopes"],
    ["mechanics/"],
    ["mechanics/courses"],
    ["mechanics/routes", "mechanics/lines", "mechanics/motion", "mechanics/swinging"],
    ["mechanics/slices"],
    ["mechanics/loads", "mechanics/kinematics"],
    ["model/tree"],
    ["model/joints", "model/rods"],
    ["model/bodies", "model/steps"],
    ["model/materials", "model/fluids"],
    ["model/"],
    ["lie/screws", "lie/arcs", "lie/motion", "lie/magnus"],
    ["lie/se3"],
    ["lie/so3"],
    ["lie/stumpff"],
    ["quantities"],
    ["records", "units"],
]
FILES = [  # inside files/, the rest below these
    ["result_file"],
    ["problem_file", "schemas"],
    ["robot_file", "expectations"],
    ["loader"],
]
FREE_INSIDE = {  # folders whose modules may import one another, without cycles
    "programs": "the modules of one family stand on each other",
    "cli": "commands share their printing",
    "report": "figures share their style",
    "files": "readers share the loader",
    "codegen": "templates share their writer",
    "native": "the cache calls the compiler",
}
UPWARD = {  # the imports inside functions that look up, each with its reason
    ("mechanics/robot", "mechanics/functions"): "Robot.functions() is the door to what is built of a robot",
    ("mechanics/robot", "native/compiled"): "Robot.functions(compiled=True) is that door with a C compiler behind it",
}
LEAN = ("lie", "model", "mechanics", "programs", "native")  # these need casadi and numpy alone
SKIPPED = {"__init__"}  # the package's own holds lazy names only


@cache
def modules():
    return sorted(
        str(path.relative_to(ROOT).with_suffix("")) for path in ROOT.rglob("*.py") if path.stem not in SKIPPED
    )


@cache
def tree(module):
    return ast.parse((ROOT / f"{module}.py").read_text())


def imported(node):
    """Dotted names of an import statement; `from a import b` gives a.b too, since b may be a module."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        assert node.level == 0, "a relative import hides its floor"
        return [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return []


def own(names):
    """Modules of this package among dotted names."""
    known, found = set(modules()), set()
    for name in names:
        path = "/".join(name.split(".")[1:])
        if name.split(".")[0] == "socontrol" and path in known:
            found.add(path)
    return found


@cache
def at_top(module):
    """Modules imported when this one is."""
    names = []

    def visit(node):
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
                names.extend(imported(child))
                visit(child)

    visit(tree(module))
    return own(names)


@cache
def anywhere(module):
    """Modules imported at the top or inside functions."""
    return own(name for node in ast.walk(tree(module)) for name in imported(node))


def floor(module):
    """Height: 0 at the bottom."""
    for depth, names in enumerate(FLOORS):
        if module in names:
            return len(FLOORS) - depth
    folder = module.rpartition("/")[0] + "/"
    for depth, names in enumerate(FLOORS):
        if folder in names:
            return len(FLOORS) - depth
    raise AssertionError(f"socontrol/{module}.py stands on no floor; add it to FLOORS")


def below(module, other):
    """Whether `module` may import `other`."""
    if floor(other) < floor(module):
        return True
    folder = module.rpartition("/")[0]
    free = folder == other.rpartition("/")[0] and folder.split("/")[0] in FREE_INSIDE
    return free and floor(other) == floor(module) and story(other) <= story(module)


def story(module):
    """Height inside files/: problem files above robot files above the loader."""
    for depth, names in enumerate(FILES):
        if module in [f"files/{name}" for name in names]:
            return len(FILES) - depth
    return 0


def cycle(edges):
    """Modules of one cycle of {module: imports}, or none."""
    state, path = {}, []

    def visit(node):
        state[node] = "open"
        path.append(node)
        for other in sorted(edges.get(node, ())):
            if state.get(other) == "open":
                return path[path.index(other) :] + [other]
            if other not in state and (found := visit(other)):
                return found
        state[node] = "done"
        path.pop()
        return None

    for node in sorted(edges):
        if node not in state and (found := visit(node)):
            return found
    return None


@pytest.mark.parametrize("module", modules())
def test_a_module_imports_lower_floors_only(module):
    upward = {other for other in anywhere(module) if not below(module, other)}
    assert upward <= {other for at, other in UPWARD if at == module}


def test_no_module_imports_itself_over_others_when_loaded():
    assert cycle({module: at_top(module) for module in modules()}) is None


def test_imports_inside_functions_close_no_cycle_but_the_listed_ones():
    assert cycle({a: {b for b in anywhere(a) if (a, b) not in UPWARD} for a in modules()}) is None


def test_listed_exceptions_exist_and_stand_inside_functions():
    for module, other in UPWARD:
        assert other in anywhere(module) - at_top(module), f"{module} imports {other} no more; unlist it"


@pytest.mark.parametrize("module", [m for m in modules() if m.split("/")[0] in LEAN])
def test_the_core_needs_casadi_and_numpy_alone(module):
    roots = {name.split(".")[0] for node in ast.walk(tree(module)) for name in imported(node)}
    assert roots - set(sys.stdlib_module_names) <= {"casadi", "numpy", "socontrol"}


ALONE = """
import importlib, sys
for name in {refused}:
    sys.modules[name] = None  # an import of it now fails
for name in {modules}:
    importlib.import_module(name)
from socontrol.mechanics.robot import Description, Robot
from socontrol.model.joints import Revolute
from socontrol.model.bodies import Body
from socontrol.programs.postures.statics import Statics
arm = Revolute(axis=(0.0, 1.0, 0.0), stiffness=2.0, body=Body(mass=0.1, com=(0.2, 0.0, 0.0)))
print(Statics(robot=Robot(Description(segments={{"arm": arm}}))).solve().require()["arm.position"])
"""


def test_the_core_solves_where_nothing_but_casadi_and_numpy_is_installed():
    refused = ["pint", "pydantic", "pydantic_core", "ruamel", "ruamel.yaml", "matplotlib", "scipy", "typer"]
    names = ["socontrol." + m.replace("/", ".") for m in modules() if m.split("/")[0] in LEAN]
    code = ALONE.format(refused=refused, modules=names)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT.parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_cycle_would_be_found():
    assert cycle({"a": {"b"}, "b": {"c"}, "c": {"a"}}) == ["a", "b", "c", "a"]
    assert cycle({"a": {"b", "c"}, "b": {"c"}, "c": set()}) is None


def test_an_upward_import_would_be_found():
    assert not below("lie/se3", "mechanics/robot")
    assert not below("model/joints", "model/rods")
    assert not below("model/rods", "model/joints")
    assert not below("mechanics/robot", "programs/equilibria/balance")
    assert not below("files/loader", "files/robot_file")
    assert below("files/problem_file", "files/robot_file")
    assert below("programs/postures/statics", "programs/equilibria/balance")
