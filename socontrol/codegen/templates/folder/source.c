/* $title
 *
 * Made by socontrol $version. C99 with <math.h> alone; compiles without warnings under -Wall -Wextra -Wpedantic
 * -Wno-unused-parameter (the functions inside share one signature).
 */
#include "$prefix.h"

#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0)
#error "compile without -ffast-math and -ffinite-math-only: what is given and comes out is checked for infinities"
#endif

$casadi
$workspace/* Whether n numbers are there and finite. */
static int all_finite(const casadi_real *x, int n)
{
    int k;
    if (!x) return 0;
    for (k = 0; k < n; k++)
        if (!isfinite(x[k])) return 0;
    return 1;
}

$definitions
