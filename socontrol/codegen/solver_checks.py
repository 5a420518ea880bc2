"""What an exported solver is tried on: questions whose answers Python's own solvers found."""

from dataclasses import dataclass, replace

import numpy as np

from socontrol.codegen.ctext import literal, matrix, vector
from socontrol.codegen.part import Checks
from socontrol.programs.postures.inverse_statics import InverseSolver

SEED = 20
COLD = 20  # answers from rest
WARM = 20  # answers from neighbour to neighbour
AWAY = 5.0  # robot lengths that a target is moved away by: out of any reach
EQUAL = 1e-7  # scaled difference from Python's answer
PRECISE = 1e-11  # Ipopt's tolerance for that answer
LIMIT = 200  # iterations
PUSH = 0.3  # of the inputs' limits: strong inputs can have several equilibria


@dataclass(frozen=True)
class Trial:
    """Arguments p [SI], Python's answer [SI] (inputs, or coordinates of a statics question) and its cost."""

    p: np.ndarray
    answer: np.ndarray
    cost: float = 0.0


class Trials:
    """Trials of one question: as it stands, and at random inputs."""

    def __init__(self, reduced):
        self.reduced, self.rng = reduced, np.random.default_rng(SEED)
        self.solver = InverseSolver(_precise(reduced.question)) if reduced.inverse else None
        self.as_given = [g.value for g in reduced.given]
        lower, upper = np.array(reduced.robot.input_limits, dtype=float).reshape(-1, 2).T
        if reduced.inverse:
            lower, upper = (side[reduced.robot.n :] for side in reduced.limits)
        scale = reduced.balance.scales.u
        self.lower, self.upper = np.where(np.isfinite(lower), lower, -scale), np.where(np.isfinite(upper), upper, scale)

    def cold(self):
        """The question as it stands, and questions that random inputs answer."""
        questions = [self.as_given, *(self._at(self._inputs()) for _ in range(COLD - 1))]
        return [trial for trial in map(self._solved, questions) if trial]

    def warm(self):
        """Questions that inputs answer which go from one random point to another in small steps."""
        ends = self._inputs(), self._inputs()
        ways = (ends[0] + (ends[1] - ends[0]) * k / WARM / 2 for k in range(WARM))
        return [trial for trial in map(self._solved, map(self._at, ways)) if trial]

    def far(self):
        """The question as it stands with its exact positions moved out of reach; none where there are none."""
        found = []
        for sign in (1.0, -1.0):
            moved, any_moved = [], False
            for given in self.reduced.given:
                value, goal = given.value.copy(), self.reduced.goals.get(given.name.partition(".")[2])
                if given.name.startswith("target.") and goal.weight is None:
                    away = [unit == "m" for unit in given.units]
                    value[away] += sign * AWAY * self.reduced.robot.length
                    any_moved = any_moved or any(away)
                moved.append(value)
            if any_moved:
                found.append(Trial(_stacked(moved), np.zeros(self.size)))
        return found

    @property
    def size(self):
        """Numbers of an answer."""
        return self.reduced.inputs or self.reduced.robot.n

    def _inputs(self):
        share = self.rng.uniform(-1.0, 1.0, self.lower.size)
        rest = np.clip(0.0, self.lower, self.upper)
        return np.clip(rest + PUSH * (self.upper - self.lower) * share, self.lower, self.upper)

    def _at(self, u):
        """Arguments of the question that u answers, or None where there is no equilibrium."""
        r = self.reduced
        if not r.inverse:
            return [u if g.name == "inputs" else g.value for g in r.given]
        equilibrium = r.balance.solve(u, r.start[: r.robot.n], prescribed=r.held)
        if not equilibrium.status.solved or r.robot.overstrained(equilibrium.q):
            return None
        f = r.solver.look.functions
        goals = {f"target.{name}": goal.reached(f, equilibrium.q) for name, goal in r.goals.items()}
        return [np.asarray(goals.get(g.name, g.value), dtype=float).ravel() for g in r.given]

    def _solved(self, values):
        """The Trial of arguments that Python finds an answer to, else None."""
        if values is None:
            return None
        r, named = self.reduced, {g.name: value for g, value in zip(self.reduced.given, values, strict=True)}
        if r.inverse:
            targets = {name: value for name, value in named.items() if name.startswith("target.")}
            outcome = self.solver.find(targets)[0]
            p, u = _stacked(values), outcome.values["u"]
            return Trial(p, u, r.cost(outcome.values["q"], u, p)) if outcome.status.solved else None
        u = named.get("inputs", np.zeros(0))
        answers = [r.balance.solve(u, start, prescribed=r.held) for start in (r.start, np.zeros(r.robot.n))]
        apart = np.max(np.abs(answers[0].q - answers[1].q) / r.scales.q, initial=0.0)
        alone = all(a.status.solved for a in answers) and apart < EQUAL  # else there are several equilibria
        return Trial(_stacked(values), answers[0].q) if alone else None


def _precise(question):
    """The question with a tolerance far below EQUAL."""
    settings = question.solver
    return replace(question, solver=replace(settings, tolerance=min(settings.tolerance, PRECISE)))


def _stacked(values):
    return np.concatenate([*values, np.zeros(0)])


def checks(part, names):
    """Checks of a SolverPart: cold and warm answers, goals out of reach, and misuse."""
    trials, reduced = Trials(part.reduced), part.reduced
    kinds = {"cold": trials.cold(), "warm": trials.warm(), "far": trials.far()}
    put, at = [], 0
    for name, size, _ in part.fields:
        put.append(f"    for (k = 0; k < {size}; k++) given.{name}[k] = p[{at} + k];\n")
        at += size
    scale = reduced.scale[-trials.size :]
    tables = [_pair(kind, found, max(1, at), trials.size) for kind, found in kinds.items()]
    tables.append(vector(f"static const double trial_scale[{trials.size}]", map(literal, scale)))
    counts = {kind: len(found) for kind, found in kinds.items()}
    words = ("given", "solver", "defaults", "init", "solve", "restart", "release")
    codes = ("OK", "BAD_INPUT", "INFEASIBLE", "NOT_CONVERGED", "NO_SLOT", "POOL")
    text = TEXT.format(
        **{word: names(word) for word in words}, **{code.lower() + "_": names.macro(code) for code in codes}, **counts,
        put="".join(put) or "    (void) p;\n", size=trials.size, limit=LIMIT, equal=EQUAL, total=max(1, at),
        forward=int(not reduced.inverse), answer="inputs" if reduced.inverse else "coordinates",
        counter="    int k;\n" if put else "",
        poison=f"    given.{part.fields[0][0]}[0] = NAN;\n" if part.fields else "", refused=1 if part.fields else 0,
    )  # fmt: skip
    return Checks("\n".join([*tables, text]), ("test_cold", "test_warm", "test_far", "test_misuse"))


def _pair(kind, found, size, answers):
    """Tables of arguments, answers and costs."""
    ps = [t.p if t.p.size else np.zeros(1) for t in found] or [np.zeros(size)]
    rows, costs = [t.answer for t in found] or [np.zeros(answers)], [t.cost for t in found] or [0.0]
    return (
        matrix(f"static const double {kind}_p[][{size}]", ps)
        + matrix(f"static const double {kind}_answer[][{answers}]", rows)
        + vector(f"static const double {kind}_cost[]", map(literal, costs))
    )


TEXT = """\
static {solver} tried;

/* Status of a solve; `cold`: from rest. */
static int ask(const double *p, int cold, int limit)
{{
    {given} given;
{counter}    {defaults}(&given);
{put}    if (cold) {restart}(&tried);
    return {solve}(&tried, &given, limit);
}}

/* Trials of one kind. Warm: all must converge; where there are several minima they stay at theirs. Cold: nine of ten
   must converge, and as many to the very answer or to one that costs less. */
static int try_all(const char *name, const double (*p)[{total}], const double (*answers)[{size}], const double *costs,
                   int count, int cold)
{{
    double difference = 0.0;
    int k, j, other = 0, failed = 0, status = {init}(&tried), steps = 0;
    for (k = 0; k < count && status == {ok_}; k++) {{
        double apart = 0.0;
        if (ask(p[k], cold, {limit}) != {ok_}) {{
            failed++;
            continue;
        }}
        for (j = 0; j < {size}; j++) apart = larger(apart, fabs(tried.{answer}[j] - answers[k][j]) / trial_scale[j]);
        if (tried.iterations > steps) steps = tried.iterations;
        if (apart <= {equal!r}) difference = larger(difference, apart);
        else if ({forward} || tried.cost > costs[k] + 1e-7 * (1 + fabs(costs[k]))) other++;
    }}
    {release}(&tried);
    printf("    %s: %d of %d solved, %d elsewhere, at most %d steps\\n", name, count - failed, count, other, steps);
    if (10 * failed > count * cold || (cold && 10 * other > count) || status != {ok_}) difference = INFINITY;
    return report(name, count, difference, {equal!r});
}}

static int test_cold(void) {{ return try_all("cold", cold_p, cold_answer, cold_cost, {cold}, 1); }}

static int test_warm(void) {{ return try_all("warm", warm_p, warm_answer, warm_cost, {warm}, 0); }}

static int test_far(void)
{{
    int k, missed = {init}(&tried) != {ok_};
    int named = 0;
    for (k = 0; k < {far}; k++) {{
        const int status = ask(far_p[k], 1, {limit});
        missed += status == {ok_};
        named += status == {infeasible_};
    }}
    (void) far_answer;
    (void) far_cost;
    {release}(&tried);
    printf("    out of reach: %d of {far} called infeasible, none may be called solved\\n", named);
    return report("out of reach", {far}, missed, 0.5);
}}

static int test_misuse(void)
{{
    static {solver} more[{pool_} + 1];
    {given} given;
    int k, missed = 0;
    {defaults}(&given);
    for (k = 0; k < {pool_}; k++) missed += {init}(more + k) != {ok_};
    missed += {init}(more + {pool_}) != {no_slot_};
    missed += {solve}(more + {pool_}, &given, {limit}) != {bad_input_};
    missed += {solve}(more, 0, {limit}) != {bad_input_};
    missed += {solve}(more, &given, -1) != {bad_input_};
{poison}    missed += {refused} && {solve}(more, &given, {limit}) != {bad_input_};
    for (k = 0; k < {pool_}; k++) missed += {release}(more + k) != {ok_};
    missed += {release}(more) != {bad_input_};
    return report("misuse", 6, missed, 0.5);
}}
"""
