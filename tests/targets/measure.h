/* Instructions and stack of one call on the Cortex-M7 in QEMU, for programs written by cortex_m7.measure. */
#include <stdint.h>
#include <stdio.h>

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_VALUE (*(volatile uint32_t *)0xE000E018u)
#define INSTRUCTIONS_A_TICK 40u /* the timer runs at 25 MHz, an instruction takes a nanosecond (-icount shift=0) */

unsigned stack_used(void);
void stack_paint(void);
extern uint32_t stack_top[];

static uint32_t stack_pointer(void) {
    uint32_t pointer;
    __asm__ volatile("mov %0, sp" : "=r"(pointer));
    return pointer;
}

#define MEASURE(name, call)                                                                               \
    do {                                                                                                  \
        uint32_t before, ticks;                                                                           \
        int code, stack;                                                                                  \
        SYSTICK_RELOAD = 0xFFFFFFu;                                                                       \
        SYSTICK_VALUE = 0u;                                                                               \
        SYSTICK_CONTROL = 5u; /* on, at the processor's clock, no interrupt */                            \
        stack_paint();                                                                                    \
        before = SYSTICK_VALUE;                                                                           \
        code = call;                                                                                      \
        ticks = (before - SYSTICK_VALUE) & 0xFFFFFFu;                                                     \
        stack = (int)stack_used() - (int)((uint32_t)(uintptr_t)stack_top - stack_pointer());              \
        printf("%s %d %lu %d\n", name, code, (unsigned long)(ticks * INSTRUCTIONS_A_TICK), stack);        \
    } while (0)
