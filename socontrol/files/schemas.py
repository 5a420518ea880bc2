"""JSON Schema of robot and problem files, for editors: keys, kinds, units in the descriptions."""

import itertools
import json
from collections import Counter

from socontrol.files.expectations import ExpectedOutcome
from socontrol.files.loader import json_schema
from socontrol.mechanics.robot import Description
from socontrol.programs.question import Expectation
from socontrol.programs.questions import QUESTIONS, Solver
from socontrol.programs.result import OUTCOMES

DIALECT = "https://json-schema.org/draft/2020-12/schema"
SHORT = 60  # characters of a part not worth a name
NAMED = ("properties", "patternProperties", "$defs")  # mappings of names to schemas


def schema(kind):
    """JSON Schema of a `robot` or `problem` file."""
    return {"$schema": DIALECT, **hoisted(SCHEMAS[kind]())}


def schema_text(kind):
    """The schema as a file holds it."""
    return json.dumps(schema(kind), indent=1, ensure_ascii=False) + "\n"


def hoisted(whole):
    """The schema with parts that stand in it more than once moved to `$defs`: half the size."""
    counts, names, definitions = Counter(), {}, dict(whole.get("$defs", {}))

    def count(node):
        if isinstance(node, dict):
            counts[json.dumps(node)] += 1
        for child in node.values() if isinstance(node, dict) else node if isinstance(node, list) else ():
            count(child)

    def moved(node, top=False):
        if isinstance(node, list):
            return [moved(item) for item in node]
        if not isinstance(node, dict):
            return node
        key = json.dumps(node)
        if top or counts[key] < 2 or len(key) < SHORT or not {"type", "anyOf", "oneOf"} & set(node):
            return {name: moved(child, name in NAMED) for name, child in node.items()}
        if key not in names:
            name = names[key] = _name(node, definitions)
            definitions[name] = {}  # taken, before parts of this part look for names
            definitions[name] = {inner: moved(child, inner in NAMED) for inner, child in node.items()}
        return {"$ref": f"#/$defs/{names[key]}"}

    count(whole)
    for name, part in whole.pop("$defs", {}).items():
        definitions[name] = moved(part, True)
    return {**moved(whole, True), "$defs": definitions}


def _name(node, taken):
    """A name for a shared part, from its description."""
    words = "".join(c if c.isalnum() else " " for c in node.get("description", node.get("title", "part"))).split()
    name = "_".join(words[:5]).lower()
    names = itertools.chain([name], (f"{name}_{k}" for k in itertools.count(2)))
    return next(free for free in names if free not in taken)


def robot_schema():
    return {**json_schema(Description), "title": "socontrol robot"}


def problem_schema():
    """One branch a problem type, the robot and solver as a path or in place."""
    shared = {"robot": _referred("robot", robot_schema()), "solver": _referred("solver", json_schema(Solver))}
    definitions, branches = {}, []
    for name, cls in QUESTIONS.items():
        branch = json_schema(cls)
        branch["properties"] = {
            "type": {"const": name, "type": "string"},
            **branch["properties"],
            **{key: {"$ref": f"#/$defs/{key}"} for key in shared},
            "expect": _expect(),
        }
        branch["required"] = ["type", *branch.get("required", [])]
        definitions |= branch.pop("$defs", {})
        branches.append(branch)
    for key, part in shared.items():
        definitions |= part.pop("$defs", {})
        definitions[key] = part
    return {"title": "socontrol problem", "oneOf": branches, "$defs": definitions}


def _referred(key, part):
    definitions = part.pop("$defs", {})
    path = {"type": "string", "description": f"path of a {key} file, relative to this file"}
    return {"anyOf": [path, part], "$defs": definitions}


def _expect():
    """`expect`: names with dots, so by pattern."""
    return {
        "type": "object",
        "description": "what the answer should be: `values.NAME`, `residuals.NAME`, `status.outcome` or `exit`",
        "properties": {
            "exit": {"enum": sorted(OUTCOMES.values())},
            "status.outcome": json_schema(ExpectedOutcome),
        },
        "patternProperties": {r"^(values|residuals)\..": json_schema(Expectation)},
        "additionalProperties": False,
    }


SCHEMAS = {"robot": robot_schema, "problem": problem_schema}
