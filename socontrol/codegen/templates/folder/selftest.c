/* Compares the C code with numbers that Python's functions gave. Prints a line for each check; exit code 1 if one fails.
 * The difference is the largest one over the largest number of that result. */
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "$prefix.h"

typedef $real real;

double larger(double a, double b);
double worst(const real *got, const real *wanted, int n);
int report(const char *name, int vectors, double difference, double allowed);

double larger(double a, double b)
{
    return a >= b ? a : b;
}

double worst(const real *got, const real *wanted, int n)
{
    double found = 0.0;
    int k;
    for (k = 0; k < n; k++) {
        const double difference = fabs((double) got[k] - (double) wanted[k]);
        if (!(difference <= found)) found = isnan(difference) ? INFINITY : difference;
    }
    return found;
}

int report(const char *name, int vectors, double difference, double allowed)
{
    const int good = difference <= allowed;
    printf("%-32s %4d vectors, difference %9.2e, allowed %9.2e: %s\n", name, vectors, difference, allowed,
           good ? "ok" : "FAILED");
    return !good;
}

$checks
int main(void)
{
    int failed = 0;
$calls
    printf(failed ? "%d checks failed\n" : "all checks passed\n", failed);
    return failed ? 1 : 0;
}
