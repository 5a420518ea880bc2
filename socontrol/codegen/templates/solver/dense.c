/* Dense linear algebra, row-major. */

static double sqp_dot(const double *a, const double *b, int n)
{
    double sum = 0;
    for (int i = 0; i < n; i++) sum += a[i] * b[i];
    return sum;
}

static double sqp_norm(const double *a, int n) { return sqrt(sqp_dot(a, a, n)); }

/* Largest |a_i|; not finite where an entry is not. */
static double sqp_largest(const double *a, int n)
{
    double most = 0;
    for (int i = 0; i < n; i++) {
        if (!isfinite(a[i])) return INFINITY;
        if (fabs(a[i]) > most) most = fabs(a[i]);
    }
    return most;
}

static void sqp_swap_rows(double *A, int i, int k, int columns)
{
    for (int j = 0; i != k && j < columns; j++) {
        const double kept = A[i * columns + j];
        A[i * columns + j] = A[k * columns + j];
        A[k * columns + j] = kept;
    }
}

/* LU with partial pivoting, in place; 0 where A [n x n] is singular. */
static int lu_factor(double *A, int *pivot, int n)
{
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (fabs(A[i * n + k]) > fabs(A[best * n + k])) best = i;
        pivot[k] = best;
        if (!(fabs(A[best * n + k]) > SQP_SINGULAR)) return 0;
        sqp_swap_rows(A, k, best, n);
        for (int i = k + 1; i < n; i++) {
            const double factor = A[i * n + k] /= A[k * n + k];
            for (int j = k + 1; j < n; j++) A[i * n + j] -= factor * A[k * n + j];
        }
    }
    return 1;
}

/* B [n x m] := A^-1 B. */
static void lu_solve(const double *A, const int *pivot, double *B, int n, int m)
{
    for (int k = 0; k < n; k++) sqp_swap_rows(B, k, pivot[k], m);
    for (int i = 1; i < n; i++)
        for (int k = 0; k < i; k++)
            for (int j = 0; j < m; j++) B[i * m + j] -= A[i * n + k] * B[k * m + j];
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            for (int j = 0; j < m; j++) B[i * m + j] -= A[i * n + k] * B[k * m + j];
        for (int j = 0; j < m; j++) B[i * m + j] /= A[i * n + i];
    }
}

/* b [n] := A^-T b. */
static void lu_solve_transposed(const double *A, const int *pivot, double *b, int n)
{
    for (int i = 0; i < n; i++) {
        for (int k = 0; k < i; k++) b[i] -= A[k * n + i] * b[k];
        b[i] /= A[i * n + i];
    }
    for (int i = n - 1; i >= 0; i--)
        for (int k = i + 1; k < n; k++) b[i] -= A[k * n + i] * b[k];
    for (int k = n - 1; k >= 0; k--) sqp_swap_rows(b, k, pivot[k], 1);
}

/* A = L L^T in the lower half of A [n x n], in place; 0 unless A is positive definite. */
static int cholesky(double *A, int n)
{
    for (int j = 0; j < n; j++)
        for (int i = j; i < n; i++) {
            double sum = A[i * n + j];
            for (int k = 0; k < j; k++) sum -= A[i * n + k] * A[j * n + k];
            if (i == j && !(sum > 0)) return 0;
            A[i * n + j] = i == j ? sqrt(sum) : sum / A[j * n + j];
        }
    return 1;
}
