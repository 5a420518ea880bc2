/* Convex quadratic program by the dual active-set method of D. Goldfarb, A. Idnani, Math. Prog. 27 (1983):

       minimise  x'Gx/2 + a'x   subject to   rows 0 .. QP_EQUAL - 1 of C x = b, the others C x >= b.

   J = L^-T Q and the triangle R belong to the active rows; both are turned by plane rotations as rows come and go. */

typedef struct {
    double J[QP_V * QP_V], R[QP_V * QP_V], x[QP_V], y[QP_V + 2], d[QP_V], z[QP_V], r[QP_V + 1];
    int active[QP_V + 1], count;
} qp_state;

/* Plane rotation that makes (a, b) to (|(a, b)|, 0). */
static double qp_rotation(double a, double b, double *c, double *s)
{
    const double length = sqrt(a * a + b * b);
    *c = length > 0 ? a / length : 1;
    *s = length > 0 ? b / length : 0;
    return length;
}

static void qp_rotate(double *a, double *b, double c, double s)
{
    const double old = *a;
    *a = c * old + s * *b;
    *b = c * *b - s * old;
}

/* The minimum without rows, and J = L^-T; 0 unless G is positive definite. G is overwritten. */
static int qp_start(qp_state *q, double *G, const double *a)
{
    if (!cholesky(G, QP_V)) return 0;
    for (int k = 0; k < QP_V; k++) /* column k of L^-1 is row k of J */
        for (int i = 0; i < QP_V; i++) {
            const double sum = (i == k) - sqp_dot(G + i * QP_V, q->J + k * QP_V, i);
            q->J[k * QP_V + i] = sum / G[i * QP_V + i];
        }
    for (int i = 0; i < QP_V; i++) {
        q->d[i] = 0;
        for (int k = 0; k < QP_V; k++) q->d[i] -= q->J[k * QP_V + i] * a[k];
    }
    for (int i = 0; i < QP_V; i++) q->x[i] = sqp_dot(q->J + i * QP_V, q->d, QP_V);
    q->count = 0;
    return 1;
}

/* Step z [QP_V] of x and change -r [count] of the multipliers for one more unit of a row's multiplier. */
static void qp_direction(qp_state *q, const double *row)
{
    for (int j = 0; j < QP_V; j++) {
        q->d[j] = 0;
        for (int i = 0; i < QP_V; i++) q->d[j] += q->J[i * QP_V + j] * row[i];
    }
    for (int i = 0; i < QP_V; i++)
        q->z[i] = sqp_dot(q->J + i * QP_V + q->count, q->d + q->count, QP_V - q->count);
    for (int i = q->count - 1; i >= 0; i--) {
        double sum = q->d[i];
        for (int j = i + 1; j < q->count; j++) sum -= q->R[i * QP_V + j] * q->r[j];
        q->r[i] = sum / q->R[i * QP_V + i];
    }
}

/* The row whose direction was formed last becomes active. */
static void qp_add(qp_state *q, int row)
{
    for (int j = QP_V - 2; j >= q->count; j--) {
        double c, s;
        q->d[j] = qp_rotation(q->d[j], q->d[j + 1], &c, &s);
        for (int i = 0; i < QP_V; i++) qp_rotate(q->J + i * QP_V + j, q->J + i * QP_V + j + 1, c, s);
    }
    for (int i = 0; i <= q->count; i++) q->R[i * QP_V + q->count] = q->d[i];
    q->active[q->count++] = row;
}

/* The active row at a place leaves. */
static void qp_drop(qp_state *q, int at)
{
    q->count--;
    for (int j = at; j < q->count; j++) {
        q->active[j] = q->active[j + 1];
        q->y[j] = q->y[j + 1];
        for (int i = 0; i <= j + 1; i++) q->R[i * QP_V + j] = q->R[i * QP_V + j + 1];
    }
    q->y[q->count] = q->y[q->count + 1];
    for (int j = at; j < q->count; j++) {
        double c, s, *upper = q->R + j * QP_V, *lower = upper + QP_V;
        upper[j] = qp_rotation(upper[j], lower[j], &c, &s);
        for (int k = j + 1; k < q->count; k++) qp_rotate(upper + k, lower + k, c, s);
        for (int i = 0; i < QP_V; i++) qp_rotate(q->J + i * QP_V + j, q->J + i * QP_V + j + 1, c, s);
    }
}

/* The inequality that is missed most and not active yet, or -1. */
static int qp_worst(const qp_state *q, const double *C, const double *b)
{
    double most = 0;
    int worst = -1;
    for (int i = QP_EQUAL; i < QP_ROWS; i++) {
        const double gap = (sqp_dot(C + i * QP_V, q->x, QP_V) - b[i]) / (1 + fabs(b[i]));
        int active = 0; /* then it holds but for rounding */
        for (int k = 0; k < q->count; k++) active = active || q->active[k] == i;
        if (!active && gap < -1e-12 && gap < most) {
            most = gap;
            worst = i;
        }
    }
    return worst;
}

/* Whether an equality holds at x. */
static int qp_holds(const qp_state *q, const double *C, const double *b, int row)
{
    return row < QP_EQUAL && fabs(sqp_dot(C + row * QP_V, q->x, QP_V) - b[row]) <= 1e-9 * (1 + fabs(b[row]));
}

/* Steps until a row holds: 1, or 0 where the active rows forbid it. */
static int qp_meet(qp_state *q, const double *C, const double *b, int row)
{
    const double *n = C + row * QP_V;
    q->y[q->count] = 0;
    for (;;) {
        double partial = INFINITY, full = INFINITY, slope, step;
        int leaving = -1;
        qp_direction(q, n);
        slope = sqp_dot(q->z, n, QP_V);
        if (slope > QP_DEPENDENT * sqp_dot(q->d, q->d, QP_V)) full = (b[row] - sqp_dot(n, q->x, QP_V)) / slope;
        for (int k = 0; row >= QP_EQUAL && k < q->count; k++)
            if (q->active[k] >= QP_EQUAL && q->r[k] > 1e-14 && q->y[k] / q->r[k] < partial) {
                partial = q->y[k] / q->r[k];
                leaving = k;
            }
        if (full == INFINITY && leaving < 0) return qp_holds(q, C, b, row); /* an equality that repeats others is no harm */
        step = partial < full ? partial : full;
        for (int i = 0; full < INFINITY && i < QP_V; i++) q->x[i] += step * q->z[i];
        for (int k = 0; k < q->count; k++) q->y[k] -= step * q->r[k];
        q->y[q->count] += step;
        if (!(partial < full)) {
            qp_add(q, row);
            return 1;
        }
        qp_drop(q, leaving);
    }
}

/* 1: x and y [QP_ROWS] are set, a + Gx = C'y; 0: rows contradict each other, or G is not positive definite. */
static int qp_solve(qp_state *q, double *G, const double *a, const double *C, const double *b, double *y)
{
    if (!qp_start(q, G, a)) return 0;
    for (int row = 0; row < QP_EQUAL; row++)
        if (!qp_meet(q, C, b, row)) return 0;
    for (int steps = 0; steps < 20 + 10 * QP_ROWS; steps++) {
        const int row = qp_worst(q, C, b);
        if (row < 0) {
            for (int k = 0; k < QP_EQUAL; k++)
                if (!qp_holds(q, C, b, k)) return 0;
            for (int i = 0; i < QP_ROWS; i++) y[i] = 0;
            for (int k = 0; k < q->count; k++) y[q->active[k]] = q->y[k];
            return 1;
        }
        if (!qp_meet(q, C, b, row)) return 0;
    }
    return 0;
}
