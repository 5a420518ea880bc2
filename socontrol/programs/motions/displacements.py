"""How far each coordinate of a robot moves it: by this the errors of motions are measured."""

import numpy as np


def displacement_weights(robot):
    """[n] metres that a unit of each coordinate moves the robot's ends at q = 0; turns count a tenth of its size."""
    f, weights = robot.functions(), np.zeros(robot.n)
    for segment in robot.segments:
        J = np.array(f.jacobian(segment, 1.0).function(np.zeros(robot.n)))
        moves = np.linalg.norm(J[3:], axis=0) + 0.1 * robot.length * np.linalg.norm(J[:3], axis=0)
        weights = np.maximum(weights, moves)
    return weights
