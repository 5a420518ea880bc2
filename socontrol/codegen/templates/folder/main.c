/* An example: compile it with $prefix.c. */
#include <stdio.h>
#include "$prefix.h"

int main(void)
{
$examples    return 0;
}
