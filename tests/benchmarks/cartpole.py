"""The cart-pole's swing-up in CasADi by hand, in rockit and in do-mpc: what `trajectories.py cartpole` compares.

Each takes the number of intervals and gives (build s, solve s, cost, iterations): CPU times, half the integral of the
squared force over its limit.
"""

import time

import casadi as ca
import numpy as np

from socontrol.programs.nlp.parts import Parts
from socontrol.programs.plans.schemes import scheme

SWING, WAY, FORCE = 2.0, 1.0, 20.0  # s, m, N: M. Kelly, SIAM Review 59 (2017)
CART, POLE, LONG, G = 1.0, 0.3, 0.5, 9.81  # kg, kg, m, m/s^2
POINTS = 3  # of Radau in an interval


def spent(run):
    """(what `run` returns, CPU s)."""
    began = time.process_time()
    found = run()
    return found, time.process_time() - began


def equation(q, v, a, u):
    """Equation of motion [2], SX."""
    s, c = ca.sin(q[1]), ca.cos(q[1])
    return ca.vertcat(
        (CART + POLE) * a[0] + POLE * LONG * (c * a[1] - s * v[1] ** 2) - u,
        POLE * LONG * (c * a[0] + LONG * a[1] + G * s),
    )


def layout(rule):
    """(letter, component, fraction) of each unknown of an interval; what its end holds is the next one's first four."""
    places = [("q", 0.0), ("v", 0.0), *((letter, c) for c in rule.c[:-1] for letter in "qvau"), ("a", 1.0), ("u", 1.0)]
    return [(letter, i, c) for letter, c in places for i in range(1 if letter == "u" else 2)]


def interval(rule, h, sizes):
    """Function (unknowns of an interval, state after it) -> rows, cost; `sizes`: {letter: what unknowns are over}."""
    rows, x, after = [], ca.SX.sym("x", len(layout(rule))), ca.SX.sym("after", 4)
    found = {letter: {} for letter in "qvau"}
    for k, (letter, i, c) in enumerate(layout(rule)):
        found[letter].setdefault(c, []).append(x[k] * sizes[letter][i])
    found["q"][1.0], found["v"][1.0] = (ca.vertsplit(after[2 * k : 2 * k + 2] * sizes[x]) for k, x in enumerate("qv"))
    (first, *q), (pace, *v), a, u = ([ca.vertcat(*one) for _, one in sorted(found[x].items())] for x in "qvau")
    A, V, Q = ca.horzcat(*a), rule.rates(rule.c), rule.positions(rule.c)
    for i, c in enumerate(rule.c):
        rows += [equation(q[i], v[i], a[i], u[i]) / sizes["force"], (v[i] - pace - h * A @ V[i]) / sizes["v"],
                 (q[i] - first - h * c * pace - h**2 * A @ Q[i]) / sizes["q"]]  # fmt: skip
    cost = h / 2 * ca.dot(rule.weights, (ca.vertcat(*u) / FORCE) ** 2)
    return ca.Function("interval", [x, after], [ca.vertcat(*rows), cost])


def by_hand(intervals, sizes, settings):
    """The program that socontrol makes, number by number, in plain CasADi: one Function of an interval, mapped, and its
    derivatives left to nlpsol. `settings`: Ipopt's."""
    rule, began = scheme("radau", POINTS), time.process_time()
    F = interval(rule, SWING / intervals, sizes)
    x, end = ca.MX.sym("x", F.numel_in(0), intervals), ca.MX.sym("end", 4)
    rows, costs = F.map(intervals)(x, ca.horzcat(x[:4, 1:], end))
    _, own = settings.plugin(dict.fromkeys(("grad_f", "jac_g", "hess_lag")), Parts)
    options = {"ipopt": own["ipopt"], "print_time": False, "calc_lam_p": False}
    program = {"x": ca.veccat(x, end), "f": ca.sum2(costs), "g": ca.vec(rows)}
    solver = ca.nlpsol("by_hand", "ipopt", program, options)
    build = time.process_time() - began
    bounds, start = limits(rule, intervals, sizes)
    answer, solve = spent(lambda: solver(x0=np.clip(start, *bounds), lbx=bounds[0], ubx=bounds[1], lbg=0, ubg=0))
    assert solver.stats()["success"], solver.stats()["return_status"]
    return build, solve, float(answer["f"]), int(solver.stats()["iter_count"])


def limits(rule, intervals, sizes):
    """((lower, upper), start) of the scaled unknowns by hand, the state at the end last."""
    kinds, goal = layout(rule), np.array([WAY, np.pi, 0.0, 0.0])
    size = np.array([sizes[letter][i] for letter, i, _ in kinds])
    upper = np.array([{"u": FORCE, "q": 2.0 if i == 0 else np.inf}.get(letter, np.inf) for letter, i, _ in kinds])
    shares = (np.arange(intervals)[:, None] + [c for *_, c in kinds]) / intervals
    start = np.where([letter == "q" for letter, *_ in kinds], shares * [goal[i] for _, i, _ in kinds], 0.0)
    goal = goal / size[:4]
    upper, start = np.append(np.tile(upper / size, intervals), goal), np.append(start / size, goal)
    lower = -upper
    lower[-4:] = upper[-4:]
    lower[:4] = upper[:4] = 0.0
    return (lower, upper), start


def by_rockit(intervals):
    """Force constant in an interval, integrated at its beginning."""
    import rockit

    ocp = rockit.Ocp(t0=0.0, T=SWING)
    began = time.process_time()
    y, u = ocp.state(4), ocp.control()
    ocp.set_der(y, slope(y, u))
    ocp.add_objective(ocp.integral((u / FORCE) ** 2) / 2)
    ocp.subject_to(ocp.at_t0(y) == 0)
    ocp.subject_to(ocp.at_tf(y) == [WAY, np.pi, 0, 0])
    for what, most in ((u, FORCE), (y[0], 2.0)):
        ocp.subject_to(what >= -most)
        ocp.subject_to(what <= most)
    ocp.set_initial(y, ca.vertcat(WAY * ocp.t / SWING, np.pi * ocp.t / SWING, 0, 0))
    ocp.solver("ipopt", {"ipopt": {"print_level": 0, "sb": "yes"}, "print_time": False})
    ocp.method(rockit.DirectCollocation(N=intervals, M=1, degree=POINTS, scheme="radau"))
    ocp._transcribe()
    build = time.process_time() - began
    answer, solve = spent(ocp.solve)
    times, forces = answer.sample(u, grid="control")
    cost = float(np.sum((forces[:-1] / FORCE) ** 2 * np.diff(times)) / 2)
    return build, solve, cost, int(answer.stats["iter_count"])


def by_do_mpc(intervals):
    """Force constant in an interval; from the same line of positions it comes to another, better swing."""
    import do_mpc

    began = time.process_time()
    model = do_mpc.model.Model("continuous", "SX")
    y, u = model.set_variable("_x", "y", (4, 1)), model.set_variable("_u", "u")
    model.set_rhs("y", slope(y, u))
    model.setup()
    plan = do_mpc.controller.MPC(model)
    plan.settings.n_horizon, plan.settings.t_step = intervals, SWING / intervals
    plan.settings.collocation_deg, plan.settings.collocation_type = POINTS, "radau"
    plan.settings.store_full_solution = True
    plan.settings.nlpsol_opts = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0}
    plan.set_objective(mterm=ca.SX(0), lterm=(u / FORCE) ** 2 / 2 * SWING / intervals)
    plan.set_rterm(u=0.0)
    reach = np.array([2.0, np.inf, np.inf, np.inf])
    goal = np.array([WAY, np.pi, 0.0, 0.0])
    for side, sign in (("lower", -1), ("upper", 1)):
        plan.bounds[side, "_x", "y"], plan.bounds[side, "_u", "u"] = sign * reach, sign * FORCE
        plan.terminal_bounds[side, "y"] = goal
    plan.setup()
    plan.x0 = np.zeros(4)
    plan.set_initial_guess()
    for k in range(intervals + 1):
        plan.opt_x_num["_x", k, 0, -1] = goal * [1, 1, 0, 0] * k / intervals
    build = time.process_time() - began
    _, solve = spent(lambda: plan.make_step(np.zeros(4)))
    assert plan.solver_stats["success"], plan.solver_stats["return_status"]
    cost = sum(float(plan.opt_x_num["_u", k, 0]) ** 2 * plan.opt_x_scaling["_u", 0, 0] ** 2 for k in range(intervals))
    return build, solve, float(cost) / FORCE**2 / 2 * SWING / intervals, plan.solver_stats["iter_count"]


def slope(y, u):
    """y' [4] for tools that want it solved for the accelerations."""
    s, c = ca.sin(y[1]), ca.cos(y[1])
    below = CART + POLE * s**2
    return ca.vertcat(
        y[2], y[3], (LONG * POLE * s * y[3] ** 2 + u + POLE * G * c * s) / below,
        -(LONG * POLE * c * s * y[3] ** 2 + u * c + (CART + POLE) * G * s) / (LONG * below),
    )  # fmt: skip
