"""Poses and velocities of every joint and rod, against matrix exponentials and differences of poses."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from robots import (
    CASES,
    DISTRIBUTED,
    LUMPED,
    NAMES,
    ROBOTS,
    ROD_CASES,
    ROWS,
    Plain,
    array,
    basis,
    exponential,
    gap,
    hat,
    robot,
    rod,
    vee,
)
from scipy.linalg import expm

from socontrol.lie import se3
from socontrol.mechanics.kinematics import Kinematics
from socontrol.mechanics.robot import Description, Robot
from socontrol.mechanics.statics import Statics
from socontrol.model.joints import JOINTS
from socontrol.model.rods import Rod
from socontrol.model.steps import Piece, Slice
from socontrol.model.tree import Frame

SIX_POINTS = {
    -3: -1 / 60,
    -2: 3 / 20,
    -1: -3 / 4,
    1: 3 / 4,
    2: -3 / 20,
    3: 1 / 60,
}  # central differences, order 6


def places(description):
    """(segment, X) of frames worth a look: rods also inside and at a boundary of sections."""
    for name, s in description.segments.items():
        for X in (0.0, 0.3, 0.5, 0.85, 1.0) if isinstance(s, Rod) else (0.0, 1.0):
            yield name, X


# The table of fixtures and its oracle


def test_every_kind_of_joint_and_every_row_of_strains_has_a_robot():
    assert set(LUMPED) == set(JOINTS)
    assert set(DISTRIBUTED) == set(ROWS)
    assert [LUMPED[kind].segments[next(iter(LUMPED[kind].segments))].__class__ for kind in JOINTS] == [
        *JOINTS.values()
    ]


def test_exponential_of_the_oracle_is_that_of_scipy():
    rng = np.random.default_rng(1)
    for size in (0, 1e-8, 1.0, 6.0):
        X = hat(size * rng.normal(size=(3, 6)))
        np.testing.assert_allclose(exponential(X), expm(X), rtol=0, atol=1e-12)


# Poses


@pytest.mark.parametrize("case", CASES, ids=str)
def test_poses_are_products_of_matrix_exponentials(case):
    for name, X in places(case.description):
        expected = case.plain.frame(case.q, name, X)
        assert gap(case.functions.pose(name, X)(case.q), expected) < 1e-12, (name, X)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_poses_and_jacobians_are_the_same_as_DM_SX_and_MX(case):
    name = [*case.description.segments][-1]
    frame = case.robot.tree.locate(name)
    kin = Kinematics(case.robot.tree, ca.DM(case.q))
    q = ca.MX.sym("q", case.robot.n)
    as_mx = Kinematics(case.robot.tree, q)
    both = ca.Function("both", [q], [as_mx.frame_pose(frame), as_mx.jacobian(frame)])(case.q)
    for dm, sx, mx in zip(
        (kin.frame_pose(frame), kin.jacobian(frame)),
        (case.functions.pose(name)(case.q), case.functions.jacobian(name)(case.q)),
        both,
        strict=True,
    ):
        assert gap(sx, dm) < 1e-13
        assert gap(mx, dm) < 1e-13


def test_a_boundary_between_sections_has_one_pose():
    tree = robot("simo_reissner").tree
    q = ca.DM(np.linspace(-0.5, 0.5, tree.n))
    kin = Kinematics(tree, q)
    assert (
        gap(kin.frame_pose(Frame(0, 1.0, ca.DM.eye(4))), kin.frame_pose(Frame(1, 0.0, ca.DM.eye(4)))) < 1e-15
    )


def test_coordinates_are_named_segment_by_segment_and_section_by_section():
    names = robot("branched").coordinates
    assert names[:6] == ("hub", "arm.0.twist", "arm.0.bend_y", "arm.0.bend_z", "arm.0.stretch", "arm.1.twist")
    assert names[9:15] == ("claw", "finger.0.bend_y", "finger.0.bend_z", "side.0", "side.1", "side.2")
    assert names[15:] == tuple(f"blade.0.{s}" for s in NAMES)
    assert robot("two_roots").coordinates[4:] == ("right.0.bend_z", "right.0.shear_y", "knob")
    assert robot("branched").coordinate_units[:5] == ("rad", "1/m", "1/m", "1/m", "1")


# Velocities


@pytest.mark.parametrize("case", CASES, ids=str)
def test_jacobian_columns_are_slopes_of_the_pose(case):
    for name, X in places(case.description):
        expected = case.plain.jacobian(case.q, name, X)
        assert gap(case.functions.jacobian(name, X)(case.q), expected) < 1e-12, (name, X)


@pytest.mark.parametrize("case", CASES, ids=str)
def test_velocity_is_the_slope_of_the_pose_in_time(case):
    h = 1e-3
    for name, X in places(case.description):
        pose = case.functions.pose(name, X)
        rate = sum(c * array(pose(case.q + k * h * case.qd)) for k, c in SIX_POINTS.items()) / h
        expected = vee(np.linalg.inv(array(pose(case.q))) @ rate)
        velocity = array(case.functions.jacobian(name, X)(case.q) @ case.qd)
        assert np.abs(velocity - expected).max() < 1e-8 * max(1, np.abs(expected).max()), (name, X)


@pytest.mark.parametrize("case", ROD_CASES, ids=str)
def test_velocity_changes_along_a_rod_by_the_strain_rate_less_the_bracket(case):
    kin = Kinematics(case.robot.tree, ca.DM(case.q))
    h = 0.02
    for i, piece in enumerate(case.robot.tree.pieces):
        if not piece.is_rod:
            continue

        def velocity(x, i=i):
            return array(kin.jacobian(Frame(i, x, ca.DM.eye(4))) @ case.qd)

        slope = sum(c * velocity(0.5 + k * h) for k, c in SIX_POINTS.items()) / (h * piece.length)
        columns = np.zeros((6, case.robot.n))
        columns[:, piece.columns] = array(piece.Phi).reshape(6, -1)
        xi = case.plain.strain(case.q, piece.segment, piece.index)
        eta = velocity(0.5)
        bracket = vee(hat(xi) @ hat(eta) - hat(eta) @ hat(xi))
        assert gap(slope, columns @ case.qd - bracket) < 1e-8, piece.segment


# One framework for joints and rods


def free_standing(Phi, xi_bar=(0.0,) * 6, length=1.0):
    n = np.shape(Phi)[1]
    slices = (Slice(0.5, 1.0, 0.5, None),)  # any: a piece with slices is a rod
    return Piece(
        segment="alone", index=0, record=None, parent=None, place=0.0, placement=ca.DM.eye(4),
        columns=slice(0, n), Phi=ca.DM(Phi), xi_bar=ca.DM(xi_bar), xi_star=None, length=length,
        end=ca.DM.eye(4), slices=slices,
    )  # fmt: skip


@pytest.mark.parametrize("kind", [kind for kind in LUMPED if kind != "fixed"])
@pytest.mark.parametrize("size", [0.0, 1e-9, 0.7, 3.0])
def test_a_rod_of_unit_length_without_rest_strain_is_a_joint(kind, size):
    joint = LUMPED[kind].segments["joint"]
    Phi = basis(joint)
    q = ca.DM(size * np.cos(np.arange(1.0, Phi.shape[1] + 1)))
    as_rod, as_joint = free_standing(Phi), robot(kind).tree.pieces[0]
    assert as_rod.is_rod and not as_joint.is_rod
    for (g, S), (g_joint, S_joint) in [(as_rod.step(q), as_joint.step(q))]:
        assert gap(g, g_joint) < 1e-13
        assert gap(se3.Ad_inv(g) @ S, se3.Ad_inv(g_joint) @ S_joint) < 1e-13


def test_a_rod_that_twists_only_is_a_revolute_joint_followed_by_its_length():
    L, angle = 0.3, 1.1
    twisting = Robot(Description(segments={"rod": rod(length=L, sections=1, strains=("twist",))}))
    g = Kinematics(twisting.tree, ca.DM([angle / L])).pose(0)
    base = array(twisting.tree.pieces[0].placement)
    along = np.eye(4)
    along[0, 3] = L
    assert gap(g, base @ expm(hat(np.array([angle, 0, 0, 0, 0, 0]))) @ along) < 1e-14


def simo_reissner_coordinates(row, q, sections=2):
    """The same strains as coordinates of all six strains."""
    columns = np.concatenate([6 * i + np.array(ROWS[row]) for i in range(sections)])
    out = np.zeros(6 * sections)
    out[columns] = q
    return out, columns


@pytest.mark.parametrize("shape", ["straight", "bent"])
@pytest.mark.parametrize("row", ROWS)
def test_every_row_of_strains_is_simo_reissner_with_the_others_locked(row, shape):
    case = next(c for c in CASES if c.name == row and c.shape == shape)
    q, columns = simo_reissner_coordinates(row, case.q)
    full = robot("simo_reissner").functions()
    assert gap(case.functions.pose("cap")(case.q), full.pose("cap")(q)) < 1e-14
    assert gap(case.functions.jacobian("cap")(case.q), array(full.jacobian("cap")(q))[:, columns]) < 1e-14
    locked = array(full.static_residual(q, case.u))[columns]
    assert gap(case.functions.static_residual(case.q, case.u), locked) < 1e-12


def rested(original, shift):
    """`original` with every rod's strain written as Phi q only, its coordinates moved by `shift` [n]."""
    tree = original.tree
    zero = [replace(p, xi_bar=ca.DM(6, 1)) if p.is_rod else p for p in tree.pieces]
    assert all(
        gap(p.Phi @ ca.DM(shift)[p.columns], old.xi_bar) == 0
        for p, old in zip(zero, tree.pieces, strict=True)
    )
    other = Robot(original.description)
    other.__dict__["tree"] = replace(tree, pieces=tuple(zero))
    return other


def test_rest_strain_as_a_rest_coordinate_gives_the_same_equilibrium():
    ours = Robot(
        replace(DISTRIBUTED["simo_reissner"], segments={"rod": rod(strains="simo_reissner")}, loads=None)
    )
    shift = np.tile([0, 0, 0, 1.0, 0, 0], 2)
    theirs, u = rested(ours, shift), np.array([0.7])
    q = equilibrium(ours, np.zeros(12), u)
    q_theirs = equilibrium(theirs, shift, u)
    np.testing.assert_allclose(q_theirs, q + shift, rtol=0, atol=1e-10)
    assert np.abs(q).max() > 1
    there = Kinematics(theirs.tree, ca.DM(q_theirs)).pose(1)
    assert gap(there, Kinematics(ours.tree, ca.DM(q)).pose(1)) < 1e-11


def equilibrium(of, q, u, steps=30):
    """Newton's method on residual and tangent."""
    symbol = ca.SX.sym("q", len(q))
    s = Statics(of, symbol, ca.DM(u))
    both = ca.Function("both", [symbol], [ca.densify(s.residual()), ca.densify(s.tangent())])
    for _ in range(steps):
        r, K = both(q)
        step = np.linalg.solve(array(K), array(r))
        q = q - step
        if np.abs(step).max() < 1e-13:
            break
    return q


# Limits


def test_a_section_that_turns_further_than_the_series_is_refused_by_name():
    f = robot("kirchhoff_love").functions()
    q = np.zeros(8)
    q[6] = 2 * np.pi / 0.125 * 0.999
    f.pose("rod")(q)
    q[6] = 2 * np.pi / 0.125 * 1.001
    for function, arguments in ((f.pose("rod"), ()), (f.static_residual, ([0.0],)), (f.external_force, (q,))):
        with pytest.raises(ValueError, match=r"section rod\.1 turns by 6\.29 rad.*more sections"):
            function(q, *arguments)
    q[6] = np.nan
    with pytest.raises(ValueError, match=r"coordinate rod\.1\.bend_z is nan"):
        f.jacobian("rod")(q)
    with pytest.raises(ValueError, match="7 coordinates given, 8 wanted"):
        f.pose("rod")(np.zeros(7))


def test_locked_rest_curvature_counts_towards_the_range():
    bent = Robot(Description(segments={"rod": rod(strains=("twist",), sections=1, rest={"bend_z": 25.0})}))
    with pytest.raises(ValueError, match=r"section rod\.0 turns by 6\.43 rad"):  # sqrt(25^2 + 6^2) / 4
        bent.functions().pose("rod")([6.0])
    assert bent.overstrained([6.0]) == ["rod.0 (6.43 rad)"]
    assert bent.overstrained([0.0]) == []


def test_joints_may_turn_as_far_as_they_like():
    f = robot("revolute").functions()
    for angle in (7.0, 100.0):
        assert gap(f.pose("joint")([angle]), f.pose("joint")([angle - 2 * np.pi])) < 1e-12


def test_symbols_pass_a_robot_function_unchecked():
    f = robot("kirchhoff_love").functions()
    for kind in (ca.SX, ca.MX):
        q = kind.sym("q", 8)
        pose = f.pose("rod", 0.6)(q)
        assert isinstance(pose, kind)
        assert gap(ca.Function("f", [q], [pose])(np.ones(8)), f.pose("rod", 0.6)(np.ones(8))) < 1e-15


def test_places_that_differ_little_are_different_functions():
    f = Robot(ROBOTS["kirchhoff_love"]).functions()
    q = np.ones(8)
    apart = array(f.pose("rod", 0.5 + 1e-9)(q)) - array(f.pose("rod", 0.5)(q))
    assert 0 < np.abs(apart[0, 3]) < 1e-8


def test_segments_whose_names_differ_in_punctuation_are_different_functions():
    segments = {"arm-1": rod(), "arm_1": rod(length=0.5)}
    description = Description(segments=segments)
    f, plain, q = Robot(description).functions(), Plain(description), np.ones(16)
    for name in segments:
        assert gap(f.pose(name)(q), plain.frame(q, name, 1.0)) < 1e-12


@pytest.mark.parametrize("X, sentence", [(0.5, "only 0 .* and 1"), (1.5, "outside")])
def test_a_place_that_is_not_there_is_refused(X, sentence):
    with pytest.raises(ValueError, match=sentence):
        robot("branched").functions().pose("claw", X)
    with pytest.raises(ValueError, match="unknown segment 'fingr'; did you mean 'finger'"):
        robot("branched").functions().pose("fingr", 1.0)
