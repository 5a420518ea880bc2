"""socontrol beside SoRoMoX, PyElastica and Pinocchio on the same robots, in one go: physics first, then times.

    python tests/benchmarks/peers.py [FIGURE]        (default results/peers.png; peers: pip install -e '.[peers]')

- reference rod (reference_rod.py): forward dynamics, and the time to its first result, beside SoRoMoX;
- the same rod let go from straight for one second beside PyElastica (other discretisation, other damping);
- chains of revolute joints: inverse dynamics, forward dynamics and mass matrix beside Pinocchio's RNEA, ABA and CRBA.
"""

import os

CORE = max(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None
if CORE is not None:
    os.sched_setaffinity(0, {CORE})  # before the peers load: JAX sizes its pool of threads by what it may use


