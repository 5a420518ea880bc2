"""A plan as comma-separated text for a controller: times, inputs, coordinates, their rates, lengths of lines; SI."""

import csv
import io

import numpy as np

COLUMNS = (("u", "u", "inputs"), ("q", "q", "coordinates"), ("qd", "qd", "coordinates"),
           ("length", "lengths", "inputs"))  # fmt: skip  # of the head, of the arrays, of the robot


def table(result):
    """Text of a CSV: a line of names (`t`, `u.NAME`, `q.NAME`, `qd.NAME`, `length.NAME`), then one an output.

    Numbers stand in full: read back they are the same. What the result does not hold is left out.
    """
    arrays, robot = result.arrays, result.question.robot
    head, parts = ["t"], [np.reshape(arrays["t"], (-1, 1))]
    for prefix, key, names in COLUMNS:
        if key in arrays:
            head += [f"{prefix}.{name}" for name in getattr(robot, names)]
            parts.append(np.reshape(arrays[key], (len(arrays["t"]), -1)))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(np.hstack(parts).tolist())
    return text.getvalue()
