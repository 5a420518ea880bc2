/* Prints how much stack a program used, when it ends. Linked beside startup.c, which paints the stack before main. */
#include <stdio.h>
#include <stdlib.h>

unsigned stack_used(void);

static void report(void) {
    unsigned bytes = stack_used(); /* before printf adds its own */
    printf("stack used %u bytes\n", bytes);
}

__attribute__((constructor)) static void announce(void) { atexit(report); }
