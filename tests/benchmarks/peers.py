"""socontrol beside SoRoMoX, PyElastica and Pinocchio on the same robots, in one go: physics first, then times.

    python tests/benchmarks/peers.py [FIGURE]        (default results/peers.png; peers: pip install -e '.[peers]')

- the reference rod (reference_rod.py): forward dynamics, and the time to its first result, beside SoRoMoX;
- the same rod let go from straight, one second of motion, beside PyElastica: another discretisation and damping;
- chains of revolute joints: inverse dynamics, forward dynamics and mass matrix beside Pinocchio's RNEA, ABA and CRBA.
"""

import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

CORE = max(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None
if CORE is not None:
    os.sched_setaffinity(0, {CORE})  # before the peers load: JAX makes as many threads as it finds cores

import casadi as ca  # noqa: E402
import matplotlib as mpl  # noqa: E402
import numpy as np  # noqa: E402
import reference_rod  # noqa: E402
from dynamics_scaling import arguments, buffered, calibration, clocked, state  # noqa: E402
from matplotlib.ticker import NullLocator  # noqa: E402

from socontrol.mechanics.actuators import JointTorque  # noqa: E402
from socontrol.mechanics.robot import Description, Robot  # noqa: E402
from socontrol.model.bodies import Body, Placement  # noqa: E402
from socontrol.model.joints import Revolute  # noqa: E402
from socontrol.programs.equilibria.balance import Balance  # noqa: E402
from socontrol.report import style  # noqa: E402
from socontrol.report.plots import save  # noqa: E402

PEERS = {"SoRoMoX": ("soromox", "soromox"), "PyElastica": ("elastica", "pyelastica"), "Pinocchio": ("pinocchio", "pin")}
SECTIONS, JOINTS, ELEMENTS = (1, 2, 4, 8, 16), (7, 20, 50), (20, 50, 100)
COMPILED_SECTIONS = (1, 4, 16)  # of SoRoMoX: each takes 10 to 30 s to its first result
ALGORITHMS = {"inverse_dynamics": "RNEA", "forward_dynamics": "ABA", "mass": "CRBA"}
VM, C, CALL = "socontrol VM", "socontrol C", "socontrol call"
ROUNDS = 11  # of all runs of a table in turn: a spell of foreign load spoils one round, not one column
SECONDS = 3  # runs of each simulated second
LARGEST_C = 25_000  # instructions, which take gcc 6 s; 65 000 take it 27 s
GLIMPSE = 0.25  # s after letting go: the tip has swung by 0.3 m and the motion does not yet depend on every detail
# Relative: rigid chains are exact on both sides; SoRoMoX's Gauss nodes and weights are themselves good to 5e-8;
# PyElastica and sections of constant strain discretise differently, each to some thousandths of the length.
TOLERANCE = {"Pinocchio": 1e-9, "SoRoMoX": 1e-6, "PyElastica": 0.02}


class Report:
    """Prints agreement and skips as they come; `failed`: some peer computes other physics."""

    def __init__(self):
        self.failed = False

    def agrees(self, peer, what, difference):
        good = difference <= TOLERANCE[peer]
        self.failed |= not good
        verdict = "agrees" if good else "DIFFERS"
        print(f"  {peer} {verdict}: {what}: {difference:.1e} (allowed {TOLERANCE[peer]:.0e})")

    def has(self, peer):
        found = find_spec(PEERS[peer][0]) is not None
        if not found:
            print(f"  {peer} is not installed, its rows are left out: pip install -e '.[peers]'")
        return found


def difference(a, b):
    """Largest difference of two arrays over the largest entry of the second."""
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    return float(np.max(np.abs(a.reshape(b.shape) - b)) / np.max(np.abs(b)))


def timed(runs):
    """{key: median CPU s of one run} over ROUNDS rounds through all `runs` {key: callable}."""
    rounds = {key: [] for key in runs}
    for _ in range(ROUNDS):
        for key, run in runs.items():
            rounds[key].append(clocked(run))
    return {key: float(np.median(spent)) for key, spent in rounds.items()}


def ours(robot, name, values, folder):
    """{VM, C, CALL: callable} of the robot's Function `name` at `values`, and its instructions."""
    checked = getattr(robot.functions(), name)
    size = checked.function.n_instructions()
    runs = {VM: buffered(checked.function, values)[0], CALL: lambda: checked(*values)}
    if shutil.which("gcc") and size <= LARGEST_C:
        runs[C] = buffered(compiled(checked.function, folder), values)[0]
    return runs, size


def compiled(function, folder):
    """The Function from C by gcc -O1."""
    base = Path(folder) / f"{function.name()}_{len(os.listdir(folder))}"
    code = ca.CodeGenerator(base.name, {"with_header": False})
    code.add(function)
    code.generate(f"{base.parent}/")
    subprocess.run(["gcc", "-O1", "-fPIC", "-shared", f"{base}.c", "-o", f"{base}.so"], check=True)
    return ca.external(function.name(), f"{base}.so")


def table(title, columns, times, unit=1e6, against=(VM, C, CALL)):
    """Print {(N, who): s}: one line for each N, peers also as multiples of socontrol's times."""
    columns = [who for who in columns if any(key[1] == who for key in times)]
    peers = [who for who in columns if not who.startswith("socontrol")]
    ratios = [(peer, base) for peer in peers for base in against if base in columns]
    heads = [*columns, *(f"{peer} / {base.removeprefix('socontrol ')}" for peer, base in ratios)]
    print(f"\n{title}\n" + f"{'N':>5s}" + "".join(f"{head:>{len(head) + 3}s}" for head in heads))
    for n in sorted({key[0] for key in times}):
        here = {who: times.get((n, who)) for who in columns}
        cells = [f"{here[who] * unit:.4g}" if here[who] else "-" for who in columns]
        cells += [f"{here[a] / here[b]:.2f}" if here[a] and here[b] else "-" for a, b in ratios]
        print(f"{n:5d}" + "".join(f"{cell:>{len(head) + 3}s}" for cell, head in zip(cells, heads, strict=True)))


# The reference rod: SoRoMoX


def soromox_forward(sections):
    """y = [q, qd] -> [qd, qdd], jitted, of the reference rod in SoRoMoX."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    import soromox

    link = soromox.LinkSpec.circular(
        length=1.0 / sections, radius=0.02, density=1000.0, reference_strain=[0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        young_modulus=1e6, shear_modulus=1e6 / 3, material_damping_coefficient=1e4,
    )  # fmt: skip
    rod = soromox.PCS.from_links(
        [link] * sections, structure=soromox.PCSStructure(num_gauss_points=5),
        base_pose=jnp.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),  # a quaternion with the scalar last, then the origin
    )  # fmt: skip
    return jax.jit(lambda y: rod.forward_dynamics(0.0, y))


def rods(report, folder):
    """Forward dynamics of the reference rod: {(N, who): s}."""
    print("\nreference rod, forward dynamics")
    soromox, runs, first, sizes = COMPILED_SECTIONS if report.has("SoRoMoX") else (), {}, {}, []
    for n in SECTIONS:
        q, qd, _ = state(reference_rod.robot(n))
        began = time.perf_counter()
        robot = reference_rod.robot(n)
        answer = np.array(robot.functions().forward_dynamics(q, qd, np.zeros(0))).ravel()
        first[n, CALL] = time.perf_counter() - began
        values = arguments(robot, "forward_dynamics")
        made, size = ours(robot, "forward_dynamics", values, folder)
        runs |= {(n, who): run for who, run in made.items()}
        sizes.append(size)
        if n in soromox:
            began, y = time.perf_counter(), np.concatenate([q, qd])
            forward = soromox_forward(n)
            theirs = np.array(forward(y))[6 * n :]
            first[n, "SoRoMoX"] = time.perf_counter() - began
            report.agrees("SoRoMoX", f"accelerations with N = {n} at a random q, qd", difference(theirs, answer))
            runs[n, "SoRoMoX"] = on_device(forward, y)
    times = timed(runs)
    print("  instructions at N =", ", ".join(f"{n}: {size}" for n, size in zip(SECTIONS, sizes, strict=True)))
    table("reference rod, N sections of six strains: forward dynamics [us]", (VM, C, CALL, "SoRoMoX"), times)
    table("... from the description to the first result, on the wall, compilation included [s]",
          (CALL, "SoRoMoX"), first, unit=1.0)  # fmt: skip
    return times


def on_device(forward, y):
    """A call with an array that JAX already holds, until the result is there."""
    import jax.numpy as jnp

    held = jnp.asarray(y)
    return lambda: forward(held).block_until_ready()


# One second of motion: PyElastica


class Elastica:
    """The reference rod in PyElastica, with steps of 0.01 s for each metre of element: half of what stays stable."""

    def __init__(self, elements, damping):
        import elastica as ea

        class World(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping):
            pass

        self.dt, self.world, self.stepper, self.clock = 0.01 / elements, World(), ea.PositionVerlet(), 0.0
        self.rod = ea.CosseratRod.straight_rod(
            elements, np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0]), 1.0, 0.02, 1000.0,
            youngs_modulus=1e6, shear_modulus=1e6 / 3,
        )  # fmt: skip
        self.world.append(self.rod)
        clamp = {"constrained_position_idx": (0,), "constrained_director_idx": (0,)}
        self.world.constrain(self.rod).using(ea.OneEndFixedBC, **clamp)
        self.world.add_forcing_to(self.rod).using(ea.GravityForces, acc_gravity=np.array([0.0, 0.0, -9.81]))
        damper = {"uniform_damping_constant": damping, "time_step": self.dt}
        self.world.dampen(self.rod).using(ea.AnalyticalLinearDamper, **damper)
        self.world.finalize()

    def run(self, seconds):
        """Tip [3] after as many seconds more."""
        for _ in range(round(seconds / self.dt)):
            self.clock = self.stepper.step(self.world, self.clock, self.dt)
        return np.array(self.rod.position_collection[:, -1])


def simulated(sections):
    """CPU s of one simulated second in socontrol, median of SECONDS runs; tip [3] at GLIMPSE without damping."""
    from socontrol.programs.motions.simulation import Simulation, Times

    robot = reference_rod.robot(sections)
    motion = Simulation(robot=robot, times=Times(stop=1.0, every=0.01))
    spent = []
    for _ in range(SECONDS):
        began = time.process_time()
        motion.solve().require()
        spent.append(time.process_time() - began)
    undamped = robot.with_values({"rod.material.viscosity": 0.0})
    result = Simulation(robot=undamped, times=Times(stop=GLIMPSE, every=GLIMPSE)).solve().require()
    return float(np.median(spent)), np.array(result.arrays["rod.position"])[-1]


def swung(elements):
    """CPU s of one simulated second in PyElastica, median of SECONDS runs; tip [3] at GLIMPSE."""
    spent = []
    for _ in range(SECONDS):
        rod = Elastica(elements, 0.0)
        began = time.process_time()
        tip = rod.run(GLIMPSE)
        rod.run(1.0 - GLIMPSE)
        spent.append(time.process_time() - began)
    return float(np.median(spent)), tip


def our_motion():
    """{N: (s, tip)}, empty where socontrol cannot simulate."""
    try:
        simulated(1)  # what is made once is not a cost of the first row
        return {n: simulated(n) for n in SECTIONS[:4]}
    except ImportError as missing:
        print(f"  this socontrol has no problem type `simulation`, its rows are left out ({missing})")
        return {}


def their_motion(report):
    """{n: (s, tip)}, empty without PyElastica; its shape at rest is held against socontrol's first."""
    if not report.has("PyElastica"):
        return {}
    Elastica(20, 0.0).run(1e-3)  # numba compiles here
    settled = Elastica(100, 8.0).run(4.0)  # nearly critical for the slowest swing: at rest to some 1e-6
    robot = reference_rod.robot(32)
    tip = np.array(robot.functions().pose("rod")(Balance(robot).solve([]).q))[:3, 3]
    where = f"{settled[0]:.4f}, {settled[2]:.4f} m; 32 sections {tip[0]:.4f}, {tip[2]:.4f} m"
    off = float(np.linalg.norm(settled - tip))
    report.agrees("PyElastica", f"tip (x, z) hanging at rest, 100 elements {where}; over the length", off)
    return {n: swung(n) for n in ELEMENTS}


def seconds_of_motion(report):
    """{(N, who): s of CPU for one second of motion}."""
    print("\nreference rod, let go from straight")
    answers = {"PyElastica": their_motion(report), "socontrol": our_motion()}
    finest = {who: max(rows) for who, rows in answers.items() if rows}
    if len(finest) == 2:
        a, b = (answers[who][n][1] for who, n in finest.items())
        what = f"tip {GLIMPSE} s after letting go without damping, {finest['PyElastica']} elements and"
        off = float(np.linalg.norm(a - b))
        report.agrees("PyElastica", f"{what} {finest['socontrol']} sections; over the length", off)
    reference = answers["PyElastica"].get(max(ELEMENTS), (0, None))[1]
    for who, n, (_, tip) in [(who, n, row) for who, rows in answers.items() for n, row in rows.items()]:
        off = f", {1e3 * np.linalg.norm(tip - reference):.1f} mm from PyElastica's finest" if len(finest) == 2 else ""
        print(f"  accuracy: {who}, N = {n}: tip then at x = {tip[0]:.4f}, z = {tip[2]:.4f} m{off}")
    times = {(n, who): row[0] for who, rows in answers.items() for n, row in rows.items()}
    if times:
        title = "reference rod, N sections (socontrol) or elements (PyElastica): one second of motion [s]"
        table(title, ("socontrol", "PyElastica"), times, unit=1.0, against=())
    return times


# Chains of revolute joints: Pinocchio


def links(n):
    """(axis, position, rotation vector, mass, com, principal inertias) of each joint and its link, by a fixed seed."""
    rng = np.random.default_rng(7)
    for k in range(n):
        axis = np.eye(3)[k % 3]
        position, turn, com = (rng.uniform(-s, s, 3) for s in (0.3, 1.5, 0.1))
        yield axis, position, turn, rng.uniform(0.5, 2.0), com, rng.uniform(0.02, 0.03, 3)


def our_chain(n):
    segments, actuators, parent = {}, {}, "world"
    for k, (axis, position, turn, mass, com, inertia) in enumerate(links(n)):
        segments[f"j{k}"] = Revolute(
            parent=parent, axis=tuple(axis), placement=Placement(tuple(position), tuple(turn)),
            body=Body(mass, tuple(com), tuple(inertia)),
        )  # fmt: skip
        actuators[f"m{k}"] = JointTorque(joint=f"j{k}")
        parent = f"j{k}"
    return Robot(Description(segments=segments, actuators=actuators))


def their_chain(n):
    """Model and data in Pinocchio: a chain goes in base first, which is the depth-first order its CRBA needs."""
    import pinocchio as pin

    model, parent = pin.Model(), 0
    kinds = (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)
    for k, (_, position, turn, mass, com, inertia) in enumerate(links(n)):
        parent = model.addJoint(parent, kinds[k % 3](), pin.SE3(pin.exp3(turn), position), f"j{k}")
        model.appendBodyToJoint(parent, pin.Inertia(mass, com, np.diag(inertia)), pin.SE3.Identity())
    return model, model.createData()


def pinocchio_runs(n, q, qd, qdd, u):
    import pinocchio as pin

    model, data = their_chain(n)
    return {
        "inverse_dynamics": lambda: pin.rnea(model, data, q, qd, qdd),
        "forward_dynamics": lambda: pin.aba(model, data, q, qd, u),
        "mass": lambda: pin.crba(model, data, q),
    }


def chains(report, folder):
    """{algorithm: {(N, who): s}}."""
    print("\nchains of revolute joints")
    beside, runs = report.has("Pinocchio"), {}
    for n in JOINTS:
        robot = our_chain(n)
        q, qd, qdd = state(robot, seed=n)
        u = np.array(robot.functions().inverse_dynamics(q, qd, qdd)).ravel()  # so that accelerations stay moderate
        values = {"inverse_dynamics": [q, qd, qdd], "forward_dynamics": [q, qd, u], "mass": [q]}
        theirs = pinocchio_runs(n, q, qd, qdd, u) if beside else {}
        for name, algorithm in ALGORITHMS.items():
            made, size = ours(robot, name, values[name], folder)
            runs |= {(name, n, who): run for who, run in made.items()}
            print(f"  {name.replace('_', ' ')}, {n} joints: {size} instructions, {size / n:.0f} a joint")
            if beside:
                answer = theirs[name]()
                if name == "mass":  # Pinocchio fills what is above the diagonal
                    answer = np.triu(answer) + np.triu(answer, 1).T
                own = np.array(getattr(robot.functions(), name)(*values[name]))
                report.agrees("Pinocchio", f"{algorithm} of {n} joints", difference(answer, own))
                runs[name, n, "Pinocchio"] = theirs[name]
    times = timed(runs)
    split = {name: {key[1:]: s for key, s in times.items() if key[0] == name} for name in ALGORITHMS}
    for name, algorithm in ALGORITHMS.items():
        title = f"chain of N revolute joints: {name.replace('_', ' ')} ({algorithm}) [us]"
        table(title, (VM, C, CALL, "Pinocchio"), split[name])
    return split


# What is measured, and the figure


def preamble():
    cpu, versions = Path("/proc/cpuinfo"), {}
    lines = cpu.read_text().splitlines() if cpu.exists() else []
    named = [line.partition(":")[2].strip() for line in lines if "model name" in line]
    model = named[0] if named else platform.processor()
    for name in ("socontrol", "casadi", "numpy", "soromox", "jax", "pyelastica", "numba", "pin"):
        try:
            versions[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            versions[name] = "not installed"
    load = f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    pinned = "not pinned" if CORE is None else f"this process on core {CORE} alone, JAX's threads included"
    print(f"{model or platform.machine()}, {os.cpu_count()} cores, {platform.platform(terse=True)}{load}; {pinned}")
    print(f"Python {platform.python_version()}; " + ", ".join(f"{name} {v}" for name, v in versions.items()))
    rounds = [calibration() for _ in range(ROUNDS)]
    print(f"calibration: {np.median(rounds):.2f} ns an SX instruction in CasADi's virtual machine (VM)")
    print(
        f"Times of one call: CPU time of the process, median of {ROUNDS} rounds of at least 2 ms through all rows.\n"
        f"  {VM}: Function.buffer(), no copies or checks. {C}: the same from C by gcc -O1, up to {LARGEST_C}\n"
        f"  instructions. {CALL}: the public call with numpy arrays, its checks and CasADi's conversions included.\n"
        "  SoRoMoX: the jitted call with an array that JAX holds, until the result is there.\n"
        "  Pinocchio: pin.rnea, pin.aba, pin.crba from Python with numpy arrays.\n"
        f"One second of motion: CPU time, median of {SECONDS} runs. PyElastica: steps of position Verlet, looped in\n"
        "  Python, undamped. socontrol: Simulation.solve with its defaults (Radau, 100 outputs, energies, Functions\n"
        "  built anew), with the rod's viscosity.\n"
        "Imports count nowhere. a / b above 1: b is faster."
    )


def draw(rod, motion, chain, path):
    figure = style.new_figure(10.5, 3.8)
    one, two, three = figure.subplots(1, 3)
    marks = {VM: "o-", C: "o:", CALL: "o--", "SoRoMoX": "s-", "PyElastica": "s-", "socontrol": "o-", "Pinocchio": "s-"}
    colours = {VM: 0, C: 0, CALL: 0, "socontrol": 0}

    def curve(ax, times, who, unit, label=None, colour=None):
        points = sorted((n, s * unit) for (n, w), s in times.items() if w == who)
        if points:
            shade = style.series(colours.get(who, 1) if colour is None else colour)[0]
            ax.loglog(*zip(*points, strict=True), marks[who], color=shade, lw=1.3, ms=4, label=label or who)

    for who in (VM, C, CALL, "SoRoMoX"):
        curve(one, rod, who, 1e6)
    for who in ("socontrol", "PyElastica"):
        curve(two, motion, who, 1.0)
    for k, (name, algorithm) in enumerate(ALGORITHMS.items()):
        for who in (VM, C, "Pinocchio"):
            curve(three, chain[name], who, 1e6, f"{algorithm}, {who}", k)
    one.set(xlabel="sections of six strains [1]", ylabel="forward dynamics of the rod [µs]")
    two.set(xlabel="sections or elements [1]", ylabel="CPU time of one second of motion [s]")
    three.set(xlabel="revolute joints [1]", ylabel="one call [µs]")
    for ax, ticks in ((one, SECTIONS), (two, (*SECTIONS[:4], *ELEMENTS)), (three, JOINTS)):
        ax.set_xticks(ticks, [str(n) for n in ticks])
        ax.xaxis.set_minor_locator(NullLocator())
        ax.grid(color="#e6e9ed", lw=0.5)
        if ax.has_data():
            ax.legend(loc="upper left")
            low, high = ax.get_ylim()
            ax.set_ylim(low, high * (high / low) ** (0.75 if ax is three else 0.35))  # room for the legend
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    save(figure, Path(path))
    print(f"\nfigure: {path}")


def main(path="results/peers.png"):
    began, report = time.perf_counter(), Report()
    preamble()
    with tempfile.TemporaryDirectory() as folder:
        if shutil.which("gcc") is None:
            print(f"gcc is not installed, the columns `{C}` are left out.")
        chain = chains(report, folder)
        rod = rods(report, folder)
        motion = seconds_of_motion(report)
    with mpl.rc_context(style.STYLE):
        draw(rod, motion, chain, path)
    verdict = "; SOME PEER COMPUTES OTHER PHYSICS" if report.failed else ""
    print(f"{time.perf_counter() - began:.0f} s in all{verdict}")
    return int(report.failed)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:2]))
