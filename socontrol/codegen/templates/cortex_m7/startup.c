/* Bare-metal start of a Cortex-M7 and its end through semihosting, for QEMU's mps2-an500 board.
 *
 * The reset handler switches the floating-point unit on, copies .data, clears .bss, paints the stack, runs main and
 * hands main's value to the host as the exit code; a processor fault ends the run with exit code 125. Output and exit go
 * to the host through newlib's rdimon. On a board of your own the vendor's start-up file stands in place of this one. */
#include <stdint.h>
#include <stdlib.h>

#define CPACR (*(volatile uint32_t *)0xE000ED88u) /* coprocessor access: CP10 and CP11 are the FPU */
#define FPCCR (*(volatile uint32_t *)0xE000EF34u) /* floating-point context: what interrupts save */
#define PAINT 0xA5A5A5A5u
#define SYS_WRITE0 0x04
#define SYS_EXIT_EXTENDED 0x20
#define APPLICATION_EXIT 0x20026u

extern uint32_t stack_limit[], stack_top[], data_image[], data_start[], data_end[], bss_start[], bss_end[];
extern int main(void);
extern void initialise_monitor_handles(void);
extern void __libc_init_array(void);
void reset_handler(void);
unsigned stack_used(void);
void stack_paint(void);
void _init(void);
void _fini(void);

/* called by newlib at start and exit; their home, crti.o, is left out with the other start files */
void _init(void) {}
void _fini(void) {}

static int semihosting(int operation, const void *argument) {
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

static uint32_t *stack_pointer(void) {
    uint32_t *top;
    __asm__ volatile("mov %0, sp" : "=r"(top));
    return top;
}

/* Fill the free part of the stack with a pattern. */
void stack_paint(void) {
    uint32_t *word, *top = stack_pointer() - 16; /* this function's own frame is left alone */
    for (word = stack_limit; word < top; word++) *word = PAINT;
}

/* The largest number of bytes of stack in use since stack_paint. */
unsigned stack_used(void) {
    uint32_t *word = stack_limit;
    while (word < stack_top && *word == PAINT) word++;
    return (unsigned)(stack_top - word) * 4u;
}

static void fault_handler(void) {
    static const uint32_t block[2] = {APPLICATION_EXIT, 125u};
    semihosting(SYS_WRITE0, "processor fault\n");
    for (;;) semihosting(SYS_EXIT_EXTENDED, block);
}

void reset_handler(void) {
    uint32_t *from = data_image, *to;
    CPACR |= 0xFu << 20;
    FPCCR |= 0x3u << 30; /* interrupts save the FPU's registers, lazily */
    __asm__ volatile("dsb\n isb" ::: "memory");
    for (to = data_start; to < data_end; to++) *to = *from++;
    for (to = bss_start; to < bss_end; to++) *to = 0u;
    initialise_monitor_handles();
    __libc_init_array();
    stack_paint();
    exit(main());
}

typedef void (*handler)(void);
__attribute__((section(".vectors"), used)) static const union {
    uint32_t *stack;
    handler call;
} vectors[16] = {
    {.stack = stack_top},      {.call = reset_handler}, {.call = fault_handler}, {.call = fault_handler},
    {.call = fault_handler}, {.call = fault_handler}, {.call = fault_handler}};
