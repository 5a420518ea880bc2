/* $title
 *
 * Made by socontrol $version. SI units and radians; twists and wrenches have the angular part first and are in the body
 * frame; matrices stand row by row. q = 0 is the straight, unstretched shape. Arrays must not overlap.
 * Functions share a static workspace: call them from one thread, not from an interrupt of one another. They allocate
 * nothing and print nothing. Where the code is not $ok the results are not to be used.
 */
#ifndef $guard
#define $guard

#ifdef __cplusplus
extern "C" {
#endif

enum {
$codes
};

$declarations
#ifdef __cplusplus
}
#endif

#endif
