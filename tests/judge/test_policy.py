"""A frozen controller as the plant: its contract, its observation, and the law that one that repeats the reference changes nothing."""

import json
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from made_trajectories import hold

import robot_retarget as rr
from robot_retarget.base.errors import ServoError, TrajectoryError, UsageError
from robot_retarget.base.files import SAMPLES
from robot_retarget.judge.build import build_plant
from robot_retarget.judge.playback import Playback, plain_goals, roll_out
from robot_retarget.judge.policy import (
    TERMS,
    Contract,
    Policy,
    PolicyLoop,
    Term,
    under_policy,
)
from robot_retarget.judge.policy_files import contract_of, from_metadata, from_yaml, read_policy, twist2
from robot_retarget.judge.report_text import headline
from robot_retarget.judge.rollout import followed, ranked
from robot_retarget.robot import load_robot
from robot_retarget.servo.judgement import require_judged

OP3 = load_robot("op3")
N = len(OP3.joint_names)
TIMES = np.arange(51)[:, None] / 50
SQUAT = replace(
    hold(OP3, 1.0), qpos=np.hstack([hold(OP3, 1.0).qpos[:, :-N], hold(OP3, 1.0).angles + 0.1 * np.sin(6 * TIMES)])
)


def gains() -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and damping (n,) of the model's own servos."""
    plant = build_plant(OP3, "free")
    return plant.model.actuator_gainprm[plant.servos, 0].copy(), -plant.model.actuator_biasprm[plant.servos, 2]


def contract(*terms: Term, rate: float = 125.0) -> Contract:
    stiffness, damping = gains()
    return Contract(rate, OP3.joint_names, np.zeros(N), np.ones(N), stiffness, damping, terms)


REPEATS = Policy(contract(Term("reference_joints")), lambda observation: observation, N)


def test_a_policy_that_returns_the_reference_gives_the_rollout_of_the_plain_simulation() -> None:
    plant = build_plant(OP3, "free")
    goals = plain_goals(plant, SQUAT, Playback(rate=125.0))
    plain = roll_out(plant, SQUAT, "free", None, goals)
    played = roll_out(under_policy(build_plant(OP3, "free"), REPEATS), SQUAT, "free", None, goals)
    assert len(plain.qpos) > 100
    np.testing.assert_array_equal(played.qpos, plain.qpos)
    np.testing.assert_array_equal(played.torque, plain.torque)


def test_the_order_of_a_contract_s_joints_is_its_own_and_other_joints_keep_the_reference() -> None:
    order = list(reversed(range(N)))[2:]
    stiffness, damping = gains()
    partial = Contract(
        125.0, tuple(OP3.joint_names[k] for k in order), np.full(N - 2, 0.1), np.full(N - 2, 0.5), stiffness[order],
        damping[order], (Term("reference_joints"),),
    )  # fmt: skip
    doubled = Policy(partial, lambda observation: (observation - 0.1) / 0.5)
    plant = build_plant(OP3, "free")
    goals = plain_goals(plant, SQUAT, Playback(rate=125.0))
    played = roll_out(under_policy(build_plant(OP3, "free"), doubled), SQUAT, "free", None, goals)
    np.testing.assert_allclose(played.qpos, roll_out(plant, SQUAT, "free", None, goals).qpos, atol=1e-9)


def test_terms_are_what_their_names_say() -> None:
    plant = under_policy(build_plant(OP3, "free"), REPEATS)
    walk = replace(SQUAT, qpos=SQUAT.qpos + np.eye(7 + N)[1] * 0.3 * TIMES)  # to the left at 0.3 m/s, looking along x
    goals = plain_goals(plant, walk, Playback(rate=125.0, settle_before=0.2))
    loop, data = PolicyLoop(plant, goals, walk), mujoco.MjData(plant.model)
    turned = np.array([np.cos(np.pi / 4), 0, np.sin(np.pi / 4), 0])  # lies on its face
    data.qpos[:3], data.qpos[3:7], data.qvel[:6] = [1.0, 2.0, 3.0], turned, [1, 2, 3, 4, 5, 6]
    row = 60
    seen = {name: TERMS[name](loop, row, data) for name in TERMS}
    np.testing.assert_allclose(seen["gravity"], [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(seen["velocity"], [-3, 2, 1], atol=1e-12)
    np.testing.assert_allclose(seen["gyro"], [4, 5, 6])
    np.testing.assert_allclose(seen["command_velocity"], [0, 0.3], atol=1e-6)
    np.testing.assert_allclose(seen["command_turn"], [0], atol=1e-9)
    np.testing.assert_allclose(seen["reference_joints"], goals.angles[row])
    np.testing.assert_allclose(seen["reference_speeds"], (goals.angles[row + 1] - goals.angles[row]) * 125)
    place = walk.qpos[0, :3] + [0, 0.3 * goals.times[row], 0] - [1, 2, 3]
    np.testing.assert_allclose(seen["reference_place"], [-place[2], place[1], place[0]], atol=1e-6)
    np.testing.assert_allclose(seen["reference_turn"], [0, 0, 0, 1, 1, 0], atol=1e-12)
    assert np.ptp(np.arctan2(seen["sin_phase"], seen["cos_phase"])) == pytest.approx(np.pi)


def test_history_is_the_latest_values_oldest_first_and_begins_with_the_first() -> None:
    seen: list[np.ndarray] = []
    listens = Policy(contract(Term("reference_joints", 2.0, 3)), lambda o: (seen.append(o), o[-N:] / 2)[1])
    plant = under_policy(build_plant(OP3, "free"), listens)
    goals = plain_goals(plant, SQUAT, Playback(rate=125.0, settle_before=0.0))
    roll_out(plant, SQUAT, "free", None, goals)
    rows = 2 * goals.angles
    np.testing.assert_array_equal(seen[0], np.tile(rows[0], 3))
    np.testing.assert_array_equal(seen[9], rows[7:10].ravel())


@pytest.mark.parametrize("newest_first", [False, True])
def test_earlier_observations_follow_the_present_one_and_are_zeros_before_the_first(newest_first: bool) -> None:
    seen: list[np.ndarray] = []
    own = replace(
        contract(Term("reference_joints")), earlier=2, newest_first=newest_first, after=(Term("actions_before"),)
    )
    plant = under_policy(build_plant(OP3, "free"), Policy(own, lambda o: (seen.append(o), o[:N])[1], 4 * N))
    goals = plain_goals(plant, SQUAT, Playback(rate=125.0, settle_before=0.0))
    roll_out(plant, SQUAT, "free", None, goals)
    rows = np.vstack([np.zeros((2, N)), goals.angles])  # actions are the reference
    for k in (0, 1, 9):
        past = rows[[k + 1, k]] if newest_first else rows[[k, k + 1]]
        np.testing.assert_array_equal(seen[k], np.concatenate([rows[k + 2], *past, rows[k]]))


def test_the_reference_s_motion_is_in_the_axes_of_its_root() -> None:
    plant = under_policy(build_plant(OP3, "free"), REPEATS)
    half = TIMES[:, 0] / 2  # turns at 1 rad/s, and moves to its own left at .3 m/s, leaning 0.2 rad to the right
    yaw = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    roll = np.array([np.cos(0.1), np.sin(0.1), 0, 0])
    turn = np.array([0.0 * roll for _ in half])
    for row, own in zip(turn, yaw, strict=True):
        mujoco.mju_mulQuat(row, own, roll)
    place = 0.3 * np.stack([np.cos(2 * half) - 1, np.sin(2 * half), 0 * half], axis=1)
    circle = replace(SQUAT, qpos=np.hstack([SQUAT.qpos[:1, :3] + place, turn, SQUAT.angles]))
    goals = plain_goals(plant, circle, Playback(rate=125.0, settle_before=0.0))
    loop = PolicyLoop(plant, goals, circle)
    ahead, left, height, *lean, rate = TERMS["reference_motion"](loop, 60, mujoco.MjData(plant.model))
    np.testing.assert_allclose([ahead, left, height], [0, 0.3 * np.cos(0.2), SQUAT.qpos[0, 2]], atol=3e-3)
    np.testing.assert_allclose([*lean, rate], [0.2, 0, np.cos(0.2)], atol=2e-3)


def test_a_wrong_width_an_unknown_term_and_a_strange_joint_are_refused_by_name() -> None:
    wide = replace(REPEATS, width=N + 1)
    with pytest.raises(UsageError, match=f"observes {N + 1} numbers, its contract gives {N}: reference_joints {N}"):
        rr.simulate(SQUAT, OP3, policy=wide, draws=0)
    with pytest.raises(UsageError, match=r"no observation 'smell'.*known: joints"):
        contract(Term("smell"))
    with pytest.raises(UsageError, match=f"gives 3 actions, its contract has {N} joints"):
        rr.simulate(SQUAT, OP3, policy=replace(REPEATS, act=lambda observation: observation[:3]), draws=0)
    strange = replace(REPEATS.contract, joints=("tail", *OP3.joint_names[1:]))
    with pytest.raises(UsageError, match="drives 'tail'; known: head_pan"):
        rr.simulate(SQUAT, OP3, policy=replace(REPEATS, contract=strange), draws=0)
    with pytest.raises(UsageError, match="mode 'free'"):
        rr.simulate(SQUAT, OP3, policy=REPEATS, mode="pinned")


def test_contracts_are_read_from_toml_and_from_metadata() -> None:
    table = {
        "rate": 50, "joints": ["a", "b"], "default": [0.1, 0.2], "scale": 0.25, "stiffness": [10, 20], "damping": 1,
        "observation": ["gyro", {"name": "joints", "scale": 2, "history": 5}],
    }  # fmt: skip
    read = contract_of(table)
    assert read.scale.tolist() == [0.25, 0.25] and read.observation == (Term("gyro"), Term("joints", 2, 5))
    with pytest.raises(UsageError, match=r"default has the shape \(3,\), there are 2 joints"):
        contract_of(table | {"default": [1, 2, 3]})
    mjlab = from_metadata(
        {
            "joint_names": "a,b", "default_joint_pos": "0.1,0.2", "action_scale": "0.5,0.6", "joint_stiffness": "10,20",
            "joint_damping": "1,2", "observation_names": "command,motion_anchor_ori_b,base_ang_vel,joint_pos,joint_vel,actions",
        }
    )  # fmt: skip
    assert [term.name for term in mjlab.observation] == [
        "reference_joints", "reference_speeds", "reference_turn", "gyro", "joints", "speeds", "actions",
    ]  # fmt: skip
    assert mjlab.scale.tolist() == [0.5, 0.6] and mjlab.damping.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("joints", "angles"),
    [
        (["left_hip_pitch_joint", "right_shoulder_roll_joint", "waist_yaw_joint"], [-0.312, -0.2, 0.0]),
        (["AAHead_yaw", "Left_Shoulder_Roll", "Left_Knee_Pitch"], [0.0, -1.35, 0.4]),
    ],
)
def test_holosoma_s_walkers_observe_a_hundred_numbers_of_29_joints(joints: list[str], angles: list[float]) -> None:
    words = {"dof_names": json.dumps(joints), "kp": "[10, 20, 30]", "kd": "[1, 2, 3]"}
    walker = from_metadata(words)
    sizes = {"gyro": 3, "gravity": 3, "command_velocity": 2, "command_turn": 1, "sin_phase": 2, "cos_phase": 2}
    assert sum(sizes.get(term.name, 29) for term in walker.observation) == 100
    assert walker.default.tolist() == angles and walker.stiffness.tolist() == [10, 20, 30]
    with pytest.raises(UsageError, match="write a contract"):
        from_metadata(words | {"dof_names": '["a", "b", "c"]'})


def test_twist2_observes_1432_numbers_of_29_joints_and_berkeley_lite_is_read_from_its_configuration() -> None:
    tracker = twist2()
    sizes = {"reference_motion": 6, "gyro": 3, "lean": 2}
    frame, after = (sum(sizes.get(term.name, 29) for term in terms) for terms in (tracker.observation, tracker.after))
    assert frame * (1 + tracker.earlier) + after == 1432
    named = dict(zip(tracker.joints, zip(tracker.default, tracker.stiffness, strict=True), strict=True))
    assert named["right_shoulder_roll_joint"] == (-0.4, 40) and named["left_knee_joint"] == (0.4, 150)
    table = {
        "policy_dt": 0.04, "joints": ["a", "b", "c"], "joint_kp": [10, 20, 30], "joint_kd": [1, 2, 3], "action_scale": 0.25,
        "default_joint_positions": [0, 0.1, 0.2], "action_indices": [1, 2], "history_length": 0, "action_limit_upper": 9,
    }  # fmt: skip
    lite = from_yaml(table)
    assert (lite.rate, lite.joints, lite.stiffness.tolist(), lite.clip) == (25, ("b", "c"), [20, 30], 9)
    with pytest.raises(UsageError, match="write a contract"):
        from_yaml(table | {"history_length": 3})


def test_numpy_layers_give_swish_and_tanh_of_the_normalised_observation(tmp_path: Path) -> None:
    draw = np.random.default_rng(0)
    width, (first, last) = 3 * (9 + 2 * N), (draw.normal(size=(3 * (9 + 2 * N), 8)), draw.normal(size=(8, 2 * N)))
    given = {
        "obs_mean": draw.normal(size=width), "obs_std": np.full(width, 2.0), "n_layers": 2, "w0": first, "w1": last,
        "b0": np.ones(8), "b1": np.zeros(2 * N), "actuator_names": [f"{joint}_act" for joint in OP3.joint_names],
        "ctrl_dt": 0.02, "obs_history": 3, "default_pose": OP3.standing()[-N:], "action_scale": 0.3,
    }  # fmt: skip
    np.savez(tmp_path / "walk.npz", **{name: np.asarray(value) for name, value in given.items()})  # pyright: ignore[reportArgumentType]
    policy, seen = read_policy(tmp_path / "walk.npz"), draw.normal(size=width)
    x = ((seen - given["obs_mean"]) / 2) @ first + 1
    np.testing.assert_allclose(policy.act(seen), np.tanh((x / (1 + np.exp(-x)) @ last)[:N]))
    assert policy.contract.joints == OP3.joint_names and policy.contract.rate == 50
    report = rr.simulate(SQUAT, OP3, policy=policy, draws=0)  # its observation has the width of the first layer
    assert report.figures["policy"] == "walk.npz"
    np.savez(tmp_path / "other.npz", qpos=np.zeros(3))
    with pytest.raises(UsageError, match="no layers of a policy"):
        read_policy(tmp_path / "other.npz")


def test_the_verdict_is_that_of_the_policy_and_play_refuses_it(tmp_path: Path) -> None:
    limp = replace(REPEATS, contract=replace(REPEATS.contract, stiffness=np.full(N, 0.01)), name="limp.onnx")
    assert rr.simulate(hold(OP3, 2.0), OP3, policy=limp, draws=0).figures["fall_s"] is not None
    report = rr.simulate(hold(OP3, 0.5), OP3, policy=REPEATS, draws=2)
    assert report.verdict == "pass" and report.figures["policy"] == "policy" and report.trajectory is not None
    path = report.trajectory.save(tmp_path / "trajectory.npz")
    report.save(tmp_path / "report.json")
    assert OP3.servo_map
    with pytest.raises(ServoError, match="judged under the policy policy, which playback does not run"):
        require_judged(path, report.trajectory, OP3.servo_map, "op3")


def test_a_policy_that_does_not_observe_the_joints_of_the_reference_is_not_asked_for_them() -> None:
    still, offset = hold(OP3, 0.3), np.eye(N)[OP3.joint_names.index("head_pan")]
    reference = replace(still, qpos=np.hstack([still.qpos[:, :-N], still.angles + 0.4 * offset]))
    tracker = Policy(contract(Term("reference_joints")), lambda _: still.angles[0])
    walker = Policy(contract(Term("command_velocity")), lambda _: still.angles[0])
    seen, unseen = (rr.simulate(reference, OP3, policy=policy, draws=0) for policy in (tracker, walker))
    assert seen.verdict == "fail" and "head_pan tracks" in seen.reasons[0]
    assert unseen.verdict == "pass" and unseen.figures["worst_joint"] == "head_pan"


def test_trajectories_are_ranked_by_the_worlds_in_which_the_controller_falls(tmp_path: Path) -> None:
    still = hold(OP3, 0.5)
    lying = replace(
        still, qpos=still.qpos * [1, 1, 1, 0, 0, 0, 0, *[1] * N] + [0, 0, 0, np.cos(0.5), np.sin(0.5), 0, 0, *[0] * N]
    )
    up, down = followed(still, OP3, REPEATS, 2, "up"), followed(lying, OP3, REPEATS, 2, "down")
    assert up.fallen == 0 and up.error < 0.02 and down.fallen == 3 and down.falls[0] is not None
    assert [each.name for each in ranked([down, up])] == ["up", "down"]
    assert up.contract()["worlds"] == 3 and len(up.executed) == len(still)
    np.testing.assert_allclose(up.executed.source_time[[0, -1]], [0, 0.5], atol=0.02)


def test_a_trajectory_that_begins_in_motion_is_followed_from_its_own_velocity() -> None:
    """A robot that is thrown falls along a parabola and turns on, under any policy; one at rest is held by no settling."""
    still, (across, turn, speed, fps) = hold(OP3, 0.2), (0.7, 1.5, 2.0, 50)
    time = np.arange(len(still)) / fps
    qpos = still.qpos.copy()
    qpos[:, 0], qpos[:, 1], qpos[:, 2] = speed * time, across * time, qpos[0, 2] + 1.0
    qpos[:, 3], qpos[:, 6] = np.cos(turn * time / 2), np.sin(turn * time / 2)
    found = followed(replace(still, qpos=qpos), OP3, REPEATS, 0).executed
    np.testing.assert_allclose(found.qpos[:, :2], qpos[: len(found), :2], atol=0.02)
    np.testing.assert_allclose(found.qpos[:, 2] - qpos[0, 2], -9.81 / 2 * time[: len(found)] ** 2, atol=0.03)
    assert 2 * np.arctan2(found.qpos[-1, 6], found.qpos[-1, 3]) == pytest.approx(turn * time[len(found) - 1], abs=0.05)


def test_the_damping_of_a_contract_replaces_that_of_joints_whose_servos_have_none() -> None:
    """The model's servos have theirs in the joints; on passive joints under servos with damping it stays."""
    states = []
    for joints, servos in ((1.0, 0.0), (0.0, 0.0), (1.0, -0.5), (0.0, -0.5)):
        plant = build_plant(OP3, "free")
        plant.model.dof_damping[plant.dofs], plant.model.actuator_biasprm[plant.servos, 2] = joints, servos
        damped = replace(REPEATS, contract=replace(REPEATS.contract, damping=np.full(N, 0.4)))
        states.append(roll_out(under_policy(plant, damped), SQUAT, "free").hinges)
    np.testing.assert_array_equal(states[0], states[1])
    np.testing.assert_array_equal(states[1], states[3])
    assert np.abs(states[2] - states[3]).max() > 1e-3


def test_a_report_under_a_policy_names_it_and_holds_the_motion_as_executed() -> None:
    plan = replace(hold(OP3, 0.5), likeness={"limb_rad": 0.1, "pace": 1.0})
    report = rr.simulate(plan, OP3, policy=REPEATS, draws=0)
    assert report.badge.text == f"pass, likeness not judged (free, under {REPEATS.name})"
    assert not [name for name in report.figures if name.startswith("feedback")]
    assert "limb_rad" not in report.figures and "limbs" not in headline(report)
    executed = report.executed
    assert executed is not None and executed.goals is None and not executed.likeness
    np.testing.assert_array_equal(executed.qpos, report.series["simulated"])
    wrong = executed.qpos[:, OP3.qpos_index] - plan.qpos[:, OP3.qpos_index]
    assert np.sqrt((wrong**2).mean()) == pytest.approx(report.figures["tracking_rms_rad"], rel=0.05)


def test_the_verdict_under_a_policy_is_that_of_the_motion_as_executed_and_not_of_its_plan(tmp_path: Path) -> None:
    """A controller that stands still under the plan of a walk is unlike the walk, by the angles that `score` measures of its motion."""
    walk = rr.read_motion(SAMPLES / "walk.bvh").frames(0, 150)
    plan = rr.retarget(walk, OP3, balance="off")
    stands = Policy(contract(Term("command_velocity")), lambda _: OP3.standing()[-N:])
    report = rr.simulate(plan, OP3, policy=stands, draws=0)
    assert (
        plan.likeness.figures()["path_off"] < 0.1 and report.figures["path_off"] > 0.5 and report.executed is not None
    )
    assert any("root path" in sentence for sentence in report.unlike) and "unlike" in report.badge.text
    limbs = rr.score(report.executed, OP3, motion=walk).figures["limb_deg_mean"]
    assert np.degrees(report.figures["limb_rad"]) == pytest.approx(limbs, rel=0.05)
    file = plan.trajectory.save(tmp_path / "plan.npz")
    again = rr.simulate(file, OP3, policy=stands, draws=0, motion=walk)
    assert again.figures["limb_rad"] == report.figures["limb_rad"] and again.unlike == report.unlike
    with pytest.raises(TrajectoryError, match="comes from walk"):
        rr.simulate(file, OP3, policy=stands, draws=0, motion=SAMPLES / "wave.bvh")


def test_an_onnx_file_is_read_with_its_contract_beside_it(tmp_path: Path) -> None:
    onnx, helper = pytest.importorskip("onnx"), pytest.importorskip("onnx.helper")
    pytest.importorskip("onnxruntime")
    values = [helper.make_tensor_value_info(name, 1, [1, N]) for name in ("obs", "action")]
    graph = helper.make_graph([helper.make_node("Identity", ["obs"], ["action"])], "same", values[:1], values[1:])
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), tmp_path / "p.onnx")
    with pytest.raises(UsageError, match=r"none\.onnx: no such file"):
        rr.simulate(SQUAT, OP3, policy=tmp_path / "none.onnx")
    with pytest.raises(UsageError, match=r"no contract .*p\.toml"):
        rr.simulate(SQUAT, OP3, policy=tmp_path / "p.onnx")
    stiffness, damping = (value.tolist() for value in gains())
    joints = ", ".join(f'"{joint}"' for joint in OP3.joint_names)
    (tmp_path / "p.toml").write_text(
        f"rate = 125\njoints = [{joints}]\ndefault = 0.0\nscale = 1.0\nstiffness = {stiffness}\ndamping = {damping}\n"
        'observation = ["reference_joints"]\n'
    )
    report = rr.simulate(hold(OP3, 0.5), OP3, policy=tmp_path / "p.onnx", draws=0)
    assert report.verdict == "pass" and report.figures["policy"] == "p.onnx"
