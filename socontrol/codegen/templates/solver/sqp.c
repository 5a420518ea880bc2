/* Sequential quadratic programming on the inputs alone.

       minimise  |R(x)|^2 / 2 + f(x)   subject to   r(x) = 0,  g(x) = 0,  side(x) >= 0,  lower <= x <= upper

   with x = (q, u), all scaled, and rows = (r, g, side, R). The balance r gives the change of shape, dq = d0 + W du with
   d0 = -K^-1 r and W = -K^-1 dr/du, and leaves a quadratic program in the inputs and one slack for each goal. The
   slacks' weight is 1 / SQP_SLACK, shifted by the multipliers: where a goal is out of reach the steps end at the nearest
   posture. The reduced Hessian is a damped BFGS matrix that starts as that of |R|^2 / 2. A step is halved until
   |R|^2 / 2 + f + nu (|g| + side) + nu_r |r| falls, if need be after a Newton correction of the shape.
   Without inputs and goals what is left is Newton's method for the balance, with load steps.
   Source: L. Biegler, J. Nocedal, C. Schmid, SIAM J. Optim. 5 (1995). */

typedef struct {
    double x[SQP_X], f, rows[SQP_ROWS], J[SQP_ROWS * SQP_X], df[SQP_X];
} sqp_point;

/* What stays from one solve to the next. */
typedef struct {
    double x[SQP_X], mu[SQP_GOALS + 1], B[SQP_U * SQP_U + 1];
} sqp_memory;

typedef struct {
    double balance, miss, stationarity;
    int iterations;
} sqp_quality;

typedef struct {
    sqp_point points[2], *at, *next;
    qp_state qp;
    double LU[SQP_Q * SQP_Q], W[SQP_Q * (SQP_U + 1)], value[SQP_ROWS], slope[(SQP_ROWS - SQP_Q) * SQP_U + 1];
    double G[QP_V * QP_V], a[QP_V], C[QP_ROWS * QP_V], b[QP_ROWS], y[QP_ROWS];
    double du[SQP_U + 1], dq[SQP_Q], gradient[SQP_U + 1], before[SQP_U + 1], mu[SQP_GOALS + 1], B[SQP_U * SQP_U + 1];
    double offset[SQP_Q + SQP_GOALS], column[SQP_Q], nu, nu_r, slack, longest, soft;
    double reals[SQP_REALS];
    int pivot[SQP_Q], integers[SQP_INTEGERS];
    const double *p, *lower, *upper;
    sqp_quality quality;
} sqp_work;

/* Rows and slopes at a point; 0 where a number is not finite. A held coordinate's balance is that it stays. */
static int sqp_evaluate(sqp_work *w, sqp_point *at)
{
    if (!sqp_model(at->x, w->p, at->rows, at->J, &at->f, at->df, w->reals, w->integers)) return 0;
    for (int k = 0; k < SQP_HELD; k++) {
        const int i = sqp_held[k];
        for (int j = 0; j < SQP_X; j++) at->J[i * SQP_X + j] = j == i;
        at->rows[i] = at->x[i] - w->lower[i];
    }
    for (int i = 0; i < SQP_Q + SQP_GOALS; i++) at->rows[i] -= w->offset[i];
    return isfinite(at->f) && sqp_largest(at->rows, SQP_ROWS) < INFINITY &&
           sqp_largest(at->J, SQP_ROWS * SQP_X) < INFINITY && sqp_largest(at->df, SQP_X) < INFINITY;
}

/* Shape by inputs: W with d0 as its last column; values and slopes of the other rows, and the cost's gradient. */
static int sqp_reduce(sqp_work *w)
{
    const sqp_point *at = w->at;
    for (int i = 0; i < SQP_Q; i++) {
        double *Wi = w->W + i * (SQP_U + 1);
        for (int j = 0; j < SQP_Q; j++) w->LU[i * SQP_Q + j] = at->J[i * SQP_X + j];
        for (int j = 0; j < SQP_U; j++) Wi[j] = -at->J[i * SQP_X + SQP_Q + j];
        Wi[SQP_U] = -at->rows[i];
    }
    if (!lu_factor(w->LU, w->pivot, SQP_Q)) return 0;
    lu_solve(w->LU, w->pivot, w->W, SQP_Q, SQP_U + 1);
    for (int k = SQP_Q; k < SQP_ROWS; k++) {
        const double *J = at->J + k * SQP_X;
        double *slope = w->slope + (k - SQP_Q) * SQP_U;
        w->value[k] = at->rows[k];
        for (int j = 0; j < SQP_U; j++) slope[j] = J[SQP_Q + j];
        for (int i = 0; i < SQP_Q; i++) {
            const double *Wi = w->W + i * (SQP_U + 1);
            for (int j = 0; J[i] != 0 && j < SQP_U; j++) slope[j] += J[i] * Wi[j];
            w->value[k] += J[i] * Wi[SQP_U];
        }
    }
    for (int j = 0; j < SQP_U; j++) {
        w->gradient[j] = at->df[SQP_Q + j];
        for (int i = 0; i < SQP_Q; i++) w->gradient[j] += at->df[i] * w->W[i * (SQP_U + 1) + j];
        for (int k = SQP_COST; k < SQP_ROWS; k++) w->gradient[j] += w->slope[(k - SQP_Q) * SQP_U + j] * w->value[k];
    }
    return 1;
}

/* B := Hessian of |R|^2 / 2 with R taken as linear, and of f as if it were SQP_SMOOTH |q|^2 / 2: scaled elastic tangents have
   a unit diagonal. */
static void sqp_restart(sqp_work *w)
{
    for (int i = 0; i < SQP_U; i++)
        for (int j = 0; j < SQP_U; j++) {
            double sum = i == j ? SQP_FLOOR : 0;
            for (int k = SQP_COST - SQP_Q; k < SQP_ROWS - SQP_Q; k++)
                sum += w->slope[k * SQP_U + i] * w->slope[k * SQP_U + j];
            for (int k = 0; SQP_SMOOTH > 0 && k < SQP_Q; k++)
                sum += SQP_SMOOTH * w->W[k * (SQP_U + 1) + i] * w->W[k * (SQP_U + 1) + j];
            w->B[i * SQP_U + j] = sum;
        }
}

/* Gradient [SQP_U] of cost and goals along the inputs, with the multipliers w->mu. */
static void sqp_lagrangian(const sqp_work *w, double *z)
{
    for (int j = 0; j < SQP_U; j++) {
        z[j] = w->gradient[j];
        for (int k = 0; k < SQP_GOALS; k++) z[j] += w->mu[k] * w->slope[k * SQP_U + j];
    }
}

/* Damped BFGS (M. Powell, 1978) after the step w->du, over which the Lagrangian's gradient came from w->before. */
static void sqp_update(sqp_work *w)
{
    double t[SQP_U + 1], Bs[SQP_U + 1], sBs, st;
    const double *s = w->du;
    sqp_lagrangian(w, t);
    for (int i = 0; i < SQP_U; i++) {
        t[i] -= w->before[i];
        Bs[i] = sqp_dot(w->B + i * SQP_U, s, SQP_U);
    }
    sBs = sqp_dot(s, Bs, SQP_U);
    st = sqp_dot(s, t, SQP_U);
    if (!(sBs > 1e-20)) return;
    if (st < 0.2 * sBs) {
        const double keep = 0.8 * sBs / (sBs - st);
        for (int i = 0; i < SQP_U; i++) t[i] = keep * t[i] + (1 - keep) * Bs[i];
        st = sqp_dot(s, t, SQP_U);
    }
    for (int i = 0; i < SQP_U; i++)
        for (int j = 0; j < SQP_U; j++) w->B[i * SQP_U + j] += t[i] * t[j] / st - Bs[i] * Bs[j] / sBs;
}

/* Two rows of C for lower <= value + slope du <= upper; where `counts` is 0 they hold everywhere. */
static void sqp_between(sqp_work *w, int row, const double *slope, double low, double high, int counts)
{
    for (int j = 0; j < SQP_U; j++) {
        w->C[row * QP_V + j] = slope[j];
        w->C[(row + 1) * QP_V + j] = -slope[j];
    }
    w->b[row] = counts && low > -SQP_FAR ? low : -SQP_FAR;
    w->b[row + 1] = counts && high < SQP_FAR ? -high : -SQP_FAR;
}

/* The quadratic program at w->at; `shapes`: whether limits of coordinates and sides of goals count. */
static void sqp_program(sqp_work *w, int shapes)
{
    const double root = sqrt(w->slack), *x = w->at->x;
    const int shifted = sqp_norm(w->mu, SQP_GOALS) <= SQP_CENTRE || w->quality.miss < SQP_NEAR;
    double unit[SQP_U + 1];
    int row = SQP_GOALS;
    memset(w->G, 0, sizeof w->G);
    memset(w->C, 0, sizeof w->C);
    for (int i = 0; i < SQP_U; i++) {
        for (int j = 0; j < SQP_U; j++) w->G[i * QP_V + j] = w->B[i * SQP_U + j];
        w->a[i] = w->gradient[i];
    }
    for (int k = 0; k < SQP_GOALS; k++) {
        w->G[(SQP_U + k) * QP_V + SQP_U + k] = 1;
        w->a[SQP_U + k] = shifted ? root * w->mu[k] : 0;
        for (int j = 0; j < SQP_U; j++) w->C[k * QP_V + j] = w->slope[k * SQP_U + j];
        w->C[k * QP_V + SQP_U + k] = -root;
        w->b[k] = -w->value[SQP_Q + k];
    }
    for (int j = 0; j < SQP_U; j++, row += 2) {
        memset(unit, 0, sizeof unit);
        unit[j] = 1;
        sqp_between(w, row, unit, w->lower[SQP_Q + j] - x[SQP_Q + j], w->upper[SQP_Q + j] - x[SQP_Q + j], 1);
    }
    for (int k = 0; k < SQP_BOUNDED; k++, row += 2) {
        const int i = sqp_bounded[k];
        const double *Wi = w->W + i * (SQP_U + 1), there = x[i] + Wi[SQP_U];
        sqp_between(w, row, Wi, w->lower[i] - there, w->upper[i] - there, shapes);
    }
    for (int k = 0; k < SQP_SIDES; k++, row += 2)
        sqp_between(w, row, w->slope + (SQP_GOALS + k) * SQP_U, -w->value[SQP_Q + SQP_GOALS + k], SQP_FAR, shapes);
}

/* The step du, dq and the multipliers mu; 0 where there is none. */
static int sqp_step(sqp_work *w)
{
    if (SQP_U > 0) {
        int found = 0;
        for (int shapes = 1; shapes >= 0 && !found; shapes--) {
            sqp_program(w, shapes);
            found = qp_solve(&w->qp, w->G, w->a, w->C, w->b, w->y);
        }
        if (!found) return 0;
        memcpy(w->du, w->qp.x, SQP_U * sizeof(double));
        for (int k = 0; k < SQP_GOALS; k++) w->mu[k] = -w->y[k];
    }
    for (int i = 0; i < SQP_Q; i++) {
        const double *Wi = w->W + i * (SQP_U + 1);
        w->dq[i] = Wi[SQP_U] + sqp_dot(Wi, w->du, SQP_U);
    }
    return 1;
}

/* How far the point w->at is from an answer; stationarity of the reduced program with the multipliers of
   its rows, over the largest of them. */
static void sqp_look(sqp_work *w)
{
    const sqp_point *at = w->at;
    double z[SQP_U + 1] = {0}, gap = 0;
    sqp_lagrangian(w, z);
    for (int k = SQP_GOALS; SQP_U > 0 && k < QP_ROWS; k++) {
        for (int j = 0; j < SQP_U; j++) z[j] -= w->y[k] * w->C[k * QP_V + j];
        if (w->y[k] > 0) gap = fmax(gap, w->y[k] * fabs(w->b[k]));
    }
    w->quality.stationarity = fmax(gap, sqp_largest(z, SQP_U)) / fmax(1, sqp_largest(w->mu, SQP_GOALS));
    w->quality.balance = sqp_largest(at->rows, SQP_Q);
    w->quality.miss = sqp_largest(at->rows + SQP_Q, SQP_GOALS);
    for (int k = SQP_Q + SQP_GOALS; k < SQP_COST; k++) w->quality.miss = fmax(w->quality.miss, -at->rows[k]);
}

static double sqp_merit(const sqp_work *w, const sqp_point *at)
{
    const double *R = at->rows + SQP_COST;
    double side = 0;
    for (int k = SQP_Q + SQP_GOALS; k < SQP_COST; k++) side = fmax(side, -at->rows[k]);
    for (int k = 0; k < SQP_BOUNDED; k++) {
        const int i = sqp_bounded[k];
        side = fmax(side, fmax(w->lower[i] - at->x[i], at->x[i] - w->upper[i]));
    }
    return at->f + sqp_dot(R, R, SQP_ROWS - SQP_COST) / 2 + w->nu * (sqp_norm(at->rows + SQP_Q, SQP_GOALS) + side) +
           w->nu_r * sqp_norm(at->rows, SQP_Q);
}

/* A penalty rises at once and falls by and by: a large one, left from far away, would allow short steps only. */
static double sqp_followed(double penalty, double wanted)
{
    return wanted > penalty ? wanted : sqrt(penalty * wanted);
}

/* Penalties above the multipliers of goals, sides and limits of coordinates, and of the balance (K^T lambda = -gradient
   along q). */
static void sqp_penalties(sqp_work *w)
{
    const sqp_point *at = w->at;
    double limits = 0;
    for (int k = SQP_GOALS + 2 * SQP_U; SQP_U > 0 && k < QP_ROWS; k++) limits += w->y[k];
    for (int i = 0; i < SQP_Q; i++) {
        double *sum = w->column + i;
        *sum = -at->df[i];
        for (int k = 0; k < SQP_GOALS; k++) *sum -= w->mu[k] * at->J[(SQP_Q + k) * SQP_X + i];
        for (int k = SQP_COST; k < SQP_ROWS; k++) *sum -= at->rows[k] * at->J[k * SQP_X + i];
        for (int k = 0; SQP_U > 0 && k < SQP_SIDES; k++)
            *sum += w->y[QP_ROWS - 2 * (SQP_SIDES - k)] * at->J[(SQP_Q + SQP_GOALS + k) * SQP_X + i];
    }
    for (int k = 0; SQP_U > 0 && k < SQP_BOUNDED; k++) {
        const double *y = w->y + SQP_GOALS + 2 * SQP_U + 2 * k;
        w->column[sqp_bounded[k]] += y[0] - y[1];
    }
    lu_solve_transposed(w->LU, w->pivot, w->column, SQP_Q);
    w->nu = sqp_followed(w->nu, 1 + 1.5 * (sqp_norm(w->mu, SQP_GOALS) + limits));
    w->nu_r = sqp_followed(w->nu_r, 1 + 1.5 * sqp_norm(w->column, SQP_Q));
}

/* Puts into w->next the longest of 1, 1/2, 1/4 ... steps that lowers the merit; 0 where none does. */
static int sqp_search(sqp_work *w)
{
    const sqp_point *from = w->at;
    sqp_point *to = w->next;
    const double start = sqp_merit(w, from), most = fmax(sqp_largest(w->dq, SQP_Q), sqp_largest(w->du, SQP_U));
    double length = most > w->longest ? w->longest / most : 1, fall = 0;
    for (int j = 0; j < SQP_U; j++) fall += w->du[j] * sqp_dot(w->B + j * SQP_U, w->du, SQP_U);
    for (int halving = 0; halving < SQP_HALVINGS; halving++, length /= 2) {
        const double bar = start - 5e-5 * length * fall + 1e-13 * (1 + fabs(start));
        for (int i = 0; i < SQP_Q; i++) to->x[i] = from->x[i] + length * w->dq[i];
        for (int j = SQP_Q; j < SQP_X; j++)
            to->x[j] = fmin(fmax(from->x[j] + length * w->du[j - SQP_Q], w->lower[j]), w->upper[j]);
        if (!sqp_evaluate(w, to)) continue;
        if (sqp_merit(w, to) <= bar) return 1;
        memcpy(w->column, to->rows, sizeof w->column);
        lu_solve(w->LU, w->pivot, w->column, SQP_Q, 1);
        for (int i = 0; i < SQP_Q; i++) to->x[i] -= w->column[i];
        if (sqp_evaluate(w, to) && sqp_merit(w, to) <= bar) return 1;
    }
    return 0;
}

/* Whether a point without a further step is an answer, or the nearest posture to a goal out of reach. */
static int sqp_meets(const sqp_quality *quality, sqp_status status)
{
    if (!(quality->balance <= SQP_BALANCE)) return 0;
    if (status == SQP_CONVERGED) return quality->miss <= SQP_MISS && quality->stationarity <= SQP_STATIONARY;
    return quality->miss >= SQP_OUT_OF_REACH && quality->stationarity <= SQP_REACH;
}

/* Whether heavier goals would move a point that stands still: then the cost held it back, and the step is theirs. */
static int sqp_heavier(sqp_work *w)
{
    const double before = w->slack;
    double miss = 0;
    w->slack = fmax(0.01 * before, SQP_SMALLEST_SLACK);
    if (w->slack < before && sqp_step(w)) {
        for (int k = 0; k < SQP_GOALS; k++)
            miss = fmax(miss, fabs(w->value[SQP_Q + k] + sqp_dot(w->slope + k * SQP_U, w->du, SQP_U)));
        if (miss < 0.5 * w->quality.miss) return 1;
    }
    w->slack = before;
    return 0;
}

/* Steps from w->at until nothing moves; `fresh`: the Hessian starts anew. */
static sqp_status sqp_iterate(sqp_work *w, int fresh, int limit)
{
    int restarts = 0, moved = 0, slow;
    double missed = INFINITY;
    w->nu = w->nu_r = 1;
    w->slack = w->soft;
    w->quality.miss = INFINITY;
    if (!sqp_evaluate(w, w->at)) return SQP_NUMERICAL;
    for (;; w->quality.iterations++) {
        double change;
        if (w->slack > SQP_SLACK) w->slack = fmax(0.5 * w->slack, SQP_SLACK);
        if (!sqp_reduce(w)) return SQP_NUMERICAL;
        if (fresh)
            sqp_restart(w);
        else if (moved)
            sqp_update(w);
        fresh = 0;
        if (!sqp_step(w)) {
            sqp_restart(w);
            if (!sqp_step(w)) return SQP_NUMERICAL;
        }
        sqp_look(w);
        slow = w->quality.miss < SQP_NEAR && w->quality.miss > 0.2 * missed;
        missed = w->quality.miss;
        change = fmax(sqp_largest(w->du, SQP_U), sqp_largest(w->dq, SQP_Q));
        if (change <= SQP_STEP && sqp_meets(&w->quality, SQP_CONVERGED)) return SQP_CONVERGED;
        if (change <= SQP_REACH && sqp_meets(&w->quality, SQP_INFEASIBLE)) {
            if (!sqp_heavier(w)) return SQP_INFEASIBLE;
            slow = 0;
        }
        if (w->quality.iterations >= limit) return SQP_NOT_CONVERGED;
        if (slow && w->slack > SQP_SMALLEST_SLACK) w->slack = fmax(0.01 * w->slack, SQP_SMALLEST_SLACK);
        sqp_penalties(w);
        moved = sqp_search(w);
        if (moved) {
            sqp_point *left = w->at;
            sqp_lagrangian(w, w->before);
            for (int j = 0; j < SQP_U; j++) w->du[j] = w->next->x[SQP_Q + j] - left->x[SQP_Q + j];
            w->at = w->next;
            w->next = left;
        } else {
            if (restarts++ == SQP_RESTARTS) return SQP_NOT_CONVERGED;
            fresh = 1;
            w->nu = w->nu_r = 1;
        }
    }
}

/* Load steps: the unbalanced force of the start is let in gradually. For the balance alone. */
static sqp_status sqp_load_steps(sqp_work *w, const double *start, int limit)
{
    double whole[SQP_Q], kept[SQP_X], t = 0, step = 0.25;
    memcpy(w->at->x, start, sizeof kept);
    memset(w->offset, 0, sizeof w->offset);
    if (!sqp_evaluate(w, w->at)) return SQP_NUMERICAL;
    memcpy(whole, w->at->rows, sizeof whole);
    while (w->quality.iterations < limit && step > 1e-4) {
        const double goal = fmin(1, t + step);
        memcpy(kept, w->at->x, sizeof kept);
        for (int i = 0; i < SQP_Q; i++) w->offset[i] = (1 - goal) * whole[i];
        if (sqp_iterate(w, 1, limit) == SQP_CONVERGED) {
            if (goal == 1) return SQP_CONVERGED;
            t = goal;
            step *= 1.5;
        } else {
            memcpy(w->at->x, kept, sizeof kept);
            step /= 2;
        }
    }
    memset(w->offset, 0, sizeof w->offset);
    return SQP_NOT_CONVERGED;
}

/* The goals walk from where they are at the start to where they shall be. */
static sqp_status sqp_walk(sqp_work *w, int limit)
{
    double start[SQP_GOALS + 1];
    sqp_status status = SQP_NOT_CONVERGED;
    if (!sqp_evaluate(w, w->at)) return SQP_NUMERICAL;
    memcpy(start, w->at->rows + SQP_Q, SQP_GOALS * sizeof(double));
    for (int k = 1; k <= SQP_STRIDES; k++) {
        for (int i = 0; i < SQP_GOALS; i++) w->offset[SQP_Q + i] = start[i] * (SQP_STRIDES - k) / SQP_STRIDES;
        status = sqp_iterate(w, k == 1, limit);
        if (status != SQP_CONVERGED) break;
    }
    memset(w->offset, 0, sizeof w->offset);
    return status == SQP_INFEASIBLE ? SQP_NOT_CONVERGED : status; /* what is in the way is not the goal */
}

/* The answer seen afresh: rows, slopes and multipliers once more at w->at, and its limits. */
static int sqp_stands(sqp_work *w, sqp_status status)
{
    memset(w->offset, 0, sizeof w->offset);
    if (!sqp_evaluate(w, w->at) || !sqp_reduce(w) || !sqp_step(w)) return 0;
    sqp_look(w);
    for (int i = 0; i < SQP_X; i++) {
        const double room = SQP_ROOM * (1 + fabs(w->at->x[i]));
        if (!(w->at->x[i] >= w->lower[i] - room && w->at->x[i] <= w->upper[i] + room)) return 0;
    }
    return sqp_meets(&w->quality, status);
}

/* A start: what is remembered, or rest; `spread` 1: with inputs amid their ranges, beyond: spread over them by multiples
   of the golden ratio. Steps from rest may end at a symmetric shape, or at limits far from the answer. */
static void sqp_start(sqp_work *w, const double *from, int spread)
{
    double *x = w->at->x;
    for (int i = 0; i < SQP_X; i++) x[i] = i < SQP_Q ? from[i] : fmin(fmax(from[i], w->lower[i]), w->upper[i]);
    for (int j = SQP_Q; spread > 0 && j < SQP_X; j++) {
        const double golden = 0.618033988749895 * (j - SQP_Q + 1), place = spread * (golden - floor(golden));
        const double low = fmax(w->lower[j], x[j] - 1), high = fmin(w->upper[j], x[j] + 1);
        x[j] = low + (high - low) * (spread == 1 ? 0.5 : place - floor(place));
    }
    for (int k = 0; k < SQP_HELD; k++) x[sqp_held[k]] = w->lower[sqp_held[k]];
}

/* Where the steps of the next start end: half of those left, but SQP_PATIENCE at the least, so that no start takes all. */
static int sqp_share(const sqp_work *w, int limit)
{
    const int left = limit - w->quality.iterations, share = left / 2 > SQP_PATIENCE ? left / 2 : SQP_PATIENCE;
    return w->quality.iterations + (share < left ? share : left);
}

/* From the memory (`warm`), from rest, from rest in short steps, with goals that walk, with goals that harden, and from
   spread inputs, until one converges; the memory keeps the last point reached. */
static sqp_status sqp_solve(sqp_work *w, sqp_memory *m, int warm, int limit)
{
    sqp_status status = SQP_NOT_CONVERGED;
    double near[SQP_X], nearest = INFINITY;
    w->quality.iterations = 0;
    w->quality.balance = w->quality.miss = w->quality.stationarity = INFINITY;
    for (int cold = !warm; cold < (SQP_U > 0 ? 5 + SQP_SPREAD : 3); cold++) {
        const int share = sqp_share(w, limit);
        double from[SQP_X];
        w->at = w->points;
        w->next = w->points + 1;
        w->longest = cold == 2 ? SQP_SHORT : SQP_LONGEST;
        w->soft = cold == 4 ? SQP_SOFT : SQP_SLACK;
        memset(w->offset, 0, sizeof w->offset);
        memset(w->du, 0, sizeof w->du);
        memset(w->y, 0, sizeof w->y);
        sqp_start(w, cold ? sqp_rest : m->x, cold == 4 ? 0 : cold - 4);
        memcpy(from, w->at->x, sizeof from);
        memcpy(w->B, m->B, sizeof w->B);
        if (cold)
            memset(w->mu, 0, sizeof w->mu);
        else
            memcpy(w->mu, m->mu, sizeof w->mu);
        status = cold == 3 ? sqp_walk(w, share) : sqp_iterate(w, cold > 0, share);
        if (SQP_U == 0 && status != SQP_CONVERGED) status = sqp_load_steps(w, from, limit);
        if (status == SQP_INFEASIBLE && w->quality.miss < nearest) {
            nearest = w->quality.miss;
            memcpy(near, w->at->x, sizeof near);
        }
        if (status == SQP_CONVERGED || w->quality.iterations >= limit) break;
    }
    if (status != SQP_CONVERGED && nearest < INFINITY) { /* the nearest of all postures that were left by no step */
        status = SQP_INFEASIBLE;
        memcpy(w->at->x, near, sizeof near);
        memset(w->mu, 0, sizeof w->mu);
        w->slack = SQP_SLACK;
    }
    if ((status == SQP_CONVERGED || status == SQP_INFEASIBLE) && !sqp_stands(w, status)) status = SQP_NOT_CONVERGED;
    memcpy(m->x, w->at->x, sizeof m->x);
    memcpy(m->mu, w->mu, sizeof m->mu);
    memcpy(m->B, w->B, sizeof m->B);
    return status;
}

/* Whether the tangent at w->at, of what is not held, is positive definite: a disturbance dies out. */
static int sqp_stable(sqp_work *w)
{
    for (int i = 0; i < SQP_Q; i++)
        for (int j = 0; j < SQP_Q; j++)
            w->LU[i * SQP_Q + j] = (w->at->J[i * SQP_X + j] + w->at->J[j * SQP_X + i]) / 2;
    for (int k = 0; k < SQP_HELD; k++)
        for (int j = 0; j < SQP_Q; j++)
            w->LU[sqp_held[k] * SQP_Q + j] = w->LU[j * SQP_Q + sqp_held[k]] = j == sqp_held[k];
    return cholesky(w->LU, SQP_Q);
}
