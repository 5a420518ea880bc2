/* $title
 *
 * Made by socontrol $version. SI units and radians; twists and wrenches have the angular part first and are in the body
 * frame; matrices stand row by row. q = 0 is the straight, unstretched shape. Arrays must not overlap.
 * $threads
 * Nothing is allocated and nothing printed. Where the code is not $ok results are not to be used, but as said below.
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
