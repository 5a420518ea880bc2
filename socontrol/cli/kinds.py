"""`socontrol list`: the families of kinds that files can name, read from the tables the reader uses."""

import dataclasses

import casadi as ca
import numpy as np

from socontrol.cli.console import console
from socontrol.lie.screws import screw_system
from socontrol.mechanics.actuators import ACTUATORS
from socontrol.mechanics.loads import LOADS
from socontrol.mechanics.loops import LOOPS
from socontrol.mechanics.routes import ROUTES
from socontrol.model.bases import STRAIN_SETS, XI_BAR, selection
from socontrol.model.joints import JOINTS
from socontrol.model.materials import MATERIALS
from socontrol.model.sections import SECTIONS
from socontrol.programs.motions.signals import SIGNALS
from socontrol.programs.plans.obstacles import OBSTACLES
from socontrol.programs.plans.plan_costs import PLAN_COSTS
from socontrol.programs.postures.costs import COSTS
from socontrol.programs.postures.goals import GOALS
from socontrol.programs.questions import QUESTIONS, SOLVERS
from socontrol.records import fields_of

FAMILIES = {  # family: (table, where it stands in a file)
    "joints": (JOINTS, "robot: segments.NAME.type"),
    "rods": (STRAIN_SETS, "robot: segments.NAME.strains of a rod"),
    "sections": (SECTIONS, "robot: segments.NAME.cross_section.type of a rod"),
    "materials": (MATERIALS, "robot: segments.NAME.material.type of a rod"),
    "actuators": (ACTUATORS, "robot: actuators.NAME.type"),
    "routes": (ROUTES, "robot: actuators.NAME.offset.type of a tendon or chamber"),
    "loads": (LOADS, "robot or problem: loads.NAME.type"),
    "loops": (LOOPS, "robot: loops.NAME.type"),
    "goals": (GOALS, "problem: goals.NAME.type"),
    "costs": (COSTS, "problem: costs.NAME.type"),
    "plan_costs": (PLAN_COSTS, "trajectory: costs.NAME.type"),
    "obstacles": (OBSTACLES, "trajectory: obstacles.NAME.type"),
    "histories": (SIGNALS, "simulation: inputs.NAME, coordinates.NAME or load_factors.NAME, .type"),
    "solvers": (SOLVERS, "problem: solver.type"),
    "problems": (QUESTIONS, "problem: type"),
}
PITCH = 0.01  # m/rad, of the example whose screw system is computed


@dataclasses.dataclass(frozen=True)
class Row:
    """A row of the joint table: name, B, xi_bar (distributed joints only), degrees of freedom, screw system."""

    name: str
    B: str
    xi_bar: str
    dof: int
    system: str
    order: int


def show_family(kind):
    """Print one family, or all their names; exit code 0."""
    out = console()
    if kind is None:
        _table(out, ("family", "kinds", "where"), [
            (name, ", ".join(table), where) for name, (table, where) in FAMILIES.items()
        ])  # fmt: skip
        out.print("socontrol list FAMILY says what each one is.")
        return 0
    table, where = FAMILIES[kind]
    out.print(f"{kind} ({where})")
    if kind in ("joints", "rods"):
        _joint_table(out, kind)
        return 0
    rows = [(name, _first_line(cls), _keys(cls)) for name, cls in table.items()]
    _table(out, ("type", "what", "keys (* needed)"), rows)
    return 0


def _joint_table(out, kind):
    """Lumped joints and sets of strains, in the terms of the published table."""
    if kind == "joints":
        heads = ("lumped", "B", "DoF", "screw system", "order", "what")
        _table(out, heads, [
            (r.name, r.B, str(r.dof), r.system, str(r.order), _first_line(JOINTS[r.name])) for r in lumped_rows()
        ])  # fmt: skip
    rows = [(r.name, r.B, r.xi_bar, str(r.dof), r.system, str(r.order)) for r in distributed_rows()]
    _table(out, ("distributed", "B", "xi_bar", "DoF", "screw system", "order"), rows)
    out.print("e1 twist, e2 e3 bending, e4 stretch, e5 e6 shear; lumped: e1-e3 turns, e4-e6 slides; p pitch.")


def lumped_rows():
    """Rows of the lumped joints in their default axes, computed from their bases."""
    rows = []
    for name, cls in JOINTS.items():
        needs_pitch = "pitch" in fields_of(cls)
        Phi = np.array(ca.DM(cls(**{"pitch": PITCH} if needs_pitch else {}).Phi())).reshape(6, -1)
        text = _basis(cls(pitch=ca.SX.sym("p")).Phi() if needs_pitch else Phi)
        system = screw_system(Phi, np.zeros(6))
        rows.append(Row(name, text, "", Phi.shape[1], system.name, system.order))
    return rows


def distributed_rows():
    """Rows of the named sets of strains."""
    rows = []
    for name, strains in STRAIN_SETS.items():
        Phi = np.array(ca.DM(selection(strains)))
        system = screw_system(Phi, np.array(XI_BAR))
        rows.append(Row(name, _basis(Phi), _column(XI_BAR), Phi.shape[1], system.name, system.order))
    return rows


def _basis(Phi):
    """`e1`, `[e3 e4]`, `e1 + p e4`, `I6`, `0`."""
    columns = [_column([Phi[i, j] for i in range(6)]) for j in range(Phi.shape[1])]
    if len(columns) == 6:
        return "I6"
    return columns[0] if len(columns) == 1 else f"[{' '.join(columns)}]" if columns else "0"


def _column(entries):
    """A twist in the unit twists e1 ... e6."""
    terms = []
    for i, x in enumerate(entries):
        if str(x) not in ("0", "0.0", "00"):
            terms.append(f"e{i + 1}" if str(x) in ("1", "1.0") else f"{x} e{i + 1}")
    return " + ".join(terms)


def _first_line(cls):
    """First sentence of a record's docstring."""
    return " ".join((cls.__doc__ or "").split("\n\n")[0].split())


def _keys(cls):
    """Keys of a record, those without a default marked."""
    needed = {f.name for f in dataclasses.fields(cls) if f.default is dataclasses.MISSING and f.init}
    return ", ".join(f"{key}*" if key in needed else key for key in fields_of(cls))


def _table(out, heads, rows):
    from rich.table import Table

    table = Table(box=None, pad_edge=False, header_style="bold", padding=(0, 2, 0, 0))
    for head in heads:
        table.add_column(head, overflow="fold", no_wrap=head not in ("what", "keys (* needed)", "kinds", "where"))
    for row in rows:
        table.add_row(*row)
    out.print(table)
