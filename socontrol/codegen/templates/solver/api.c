/* The door: arguments checked and scaled, a slot of the pool, the answer in SI. */

static struct {
    PREFIX_solver *owner;
    sqp_work work;
} sqp_pool[MACRO_POOL];

static sqp_work *sqp_slot(const PREFIX_solver *s)
{
    const int known = s && s->slot >= 0 && s->slot < MACRO_POOL && sqp_pool[s->slot].owner == s;
    return known ? &sqp_pool[s->slot].work : NULL;
}

void PREFIX_defaults(PREFIX_given *given)
{
    if (given) *given = sqp_given;
}

int PREFIX_init(PREFIX_solver *s)
{
    if (!s) return MACRO_BAD_INPUT;
    for (int k = 0; k < MACRO_POOL; k++)
        if (sqp_pool[k].owner == s) sqp_pool[k].owner = NULL;
    memset(s, 0, sizeof *s);
    s->slot = -1;
    for (int k = 0; k < MACRO_POOL; k++)
        if (!sqp_pool[k].owner) {
            sqp_pool[k].owner = s;
            s->slot = k;
            return MACRO_OK;
        }
    return MACRO_NO_SLOT;
}

int PREFIX_release(PREFIX_solver *s)
{
    if (!sqp_slot(s)) return MACRO_BAD_INPUT;
    sqp_pool[s->slot].owner = NULL;
    s->slot = -1;
    return MACRO_OK;
}

int PREFIX_restart(PREFIX_solver *s)
{
    if (!sqp_slot(s)) return MACRO_BAD_INPUT;
    s->warm = 0;
    return MACRO_OK;
}

int PREFIX_solve(PREFIX_solver *s, const PREFIX_given *given, int max_iterations)
{
    static const int codes[] = {MACRO_OK, MACRO_NOT_CONVERGED, MACRO_INFEASIBLE, MACRO_FAILED};
    double p[SQP_P + 1], lower[SQP_X], upper[SQP_X];
    sqp_work *w = sqp_slot(s);
    sqp_memory memory;
    sqp_status status;
    memcpy(lower, sqp_lower, sizeof lower);
    memcpy(upper, sqp_upper, sizeof upper);
    if (!w) return MACRO_BAD_INPUT;
    if (!given || max_iterations < 0 || !sqp_read(given, p, lower, upper)) {
        s->status = MACRO_BAD_INPUT;
        return MACRO_BAD_INPUT;
    }
    w->p = p;
    w->lower = lower;
    w->upper = upper;
    memcpy(&memory, s->memory, sizeof memory);
    status = sqp_solve(w, &memory, s->warm, max_iterations);
    memcpy(s->memory, &memory, sizeof memory);
    for (int i = 0; i < SQP_Q; i++) s->coordinates[i] = w->at->x[i] * sqp_scale[i];
    SQP_ANSWER
    s->cost = sqp_dot(w->at->rows + SQP_COST, w->at->rows + SQP_COST, SQP_ROWS - SQP_COST) / 2;
    s->cost = w->quality.balance < INFINITY ? SQP_LEVEL * (s->cost + w->at->f) : INFINITY;
    s->balance = w->quality.balance;
    s->miss = w->quality.miss;
    s->stationarity = w->quality.stationarity;
    s->iterations = w->quality.iterations;
    s->warm = status == SQP_CONVERGED;
    s->stable = w->quality.balance < INFINITY && sqp_stable(w);
    s->status = codes[status];
    return s->status;
}
