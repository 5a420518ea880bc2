"""Questions about a robot at rest: statics, inverse statics, ellipsoids, fits."""
