"""The feedback law: its signs, its bounds, and what it does when the sensor is not to be trusted."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import robot_retarget as rr
from robot_retarget.actuators.balance_tables import STANDARD_GRAVITY, Balance, Imu, JointGain
from robot_retarget.actuators.feedback import SWING, Feedback, Fusion, Law, read_feedback
from robot_retarget.actuators.goals import Goals
from robot_retarget.actuators.inertial import BodyMotion, Reading, VirtualImu, tilt_of, vertical_in
from robot_retarget.actuators.map import dump_map, load_map
from robot_retarget.base.errors import ServoError, TrajectoryError
from robot_retarget.judge.feedback import gain_matrices, joints_of_legs, lean_over_feet, planned_air
from robot_retarget.trajectory import Trajectory

DT = 0.008
STILL = Reading(np.zeros(3), np.array([0.0, 0.0, STANDARD_GRAVITY]))


def feedback(**changes: object) -> Feedback:
    values: dict[str, object] = {
        "rate": np.full((3, 2), 0.1), "tilt": np.full((3, 2), 1.0), "lower": -np.ones(3), "upper": np.ones(3),
        "reference": np.zeros((50, 4)), "bound": 0.2, "speed": 3.0, "top_speed": 4.0, "lag": 1, "fusion": 1.0,
        "fade": 0.1, "stop": np.array([0.5, 0.5]), "crouch": np.zeros(3),
        "lean": np.zeros((3, 2)), "legs": np.zeros((3, 0)), "air": np.zeros((50, 0)),
    }  # fmt: skip
    return Feedback(**values | changes)  # type: ignore[arg-type]


def leaning(roll: float, pitch: float) -> Reading:
    turn = Rotation.from_euler("YX", [pitch, roll])
    return Reading(np.zeros(3), turn.inv().apply([0, 0, STANDARD_GRAVITY]))


def test_tilt_is_roll_and_pitch_of_the_body() -> None:
    turns = Rotation.from_euler("ZYX", np.random.default_rng(0).uniform(-0.7, 0.7, (20, 3)))
    found = tilt_of(vertical_in(turns.as_quat(scalar_first=True)))
    assert np.allclose(found, turns.as_euler("ZYX")[:, [2, 1]])


def test_a_perfect_reading_is_that_of_mujoco_sensors() -> None:
    """A box thrown and spinning, with a site for MuJoCo's gyroscope and accelerometer at its centre."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><option timestep="0.0005" integrator="RK4"/><worldbody><body>
        <freejoint/><geom size=".1 .2 .3" type="box"/><site name="s"/></body></worldbody>
        <sensor><gyro site="s"/><accelerometer site="s"/></sensor></mujoco>""")
    data, motion = mujoco.MjData(model), BodyMotion(model.opt.gravity)
    data.qvel[:] = [1, 2, 3, 2, -1, 4]
    data.xfrc_applied[1] = [3, -2, 5, 0, 0, 0]
    data.qpos[3:7] = Rotation.from_euler("xyz", [0.3, -0.5, 1.0]).as_quat(scalar_first=True)
    for _ in range(200):
        motion.reading(data.qpos[3:7], data.qvel[:3], data.qvel[3:], model.opt.timestep)
        mujoco.mj_step(model, data)
    mujoco.mj_forward(model, data)
    found = motion.reading(data.qpos[3:7], data.qvel[:3], data.qvel[3:], model.opt.timestep)
    assert np.allclose(found.gyro, data.sensordata[:3], atol=1e-9)
    assert np.allclose(found.accel, data.sensordata[3:], atol=0.02)


def test_fusion_follows_a_tilt_at_once_and_forgets_a_wrong_start() -> None:
    rate, fusion = 0.8, Fusion(0.5)
    found = fusion.step(STILL, DT)
    for k in range(1, 51):
        reading = leaning(0.0, rate * k * DT)
        found = fusion.step(Reading(np.array([0.0, rate, 0.0]), reading.accel), DT)
    assert np.allclose(found, [0.0, rate * 50 * DT], atol=2e-3)
    astray = Fusion(0.5)
    astray.step(leaning(0.0, 0.3), DT)
    for _ in range(round(2.5 / DT)):
        found = astray.step(leaning(0.1, -0.1), DT)
    assert np.allclose(found, [0.1, -0.1], atol=5e-3)


def test_fusion_does_not_take_a_push_for_a_tilt() -> None:
    fusion = Fusion(1.0)
    found = fusion.step(STILL, DT)
    for _ in range(12):  # a tenth of a second at 2 g ahead
        found = fusion.step(Reading(np.zeros(3), np.array([2.0, 0.0, 1.0]) * STANDARD_GRAVITY), DT)
    assert np.abs(found).max() < 0.01


@pytest.mark.parametrize(("joint", "axis"), [("l_ank_pitch", 1), ("r_knee", 1), ("l_hip_roll", 0), ("r_ank_roll", 0)])
def test_a_positive_gain_turns_the_trunk_upright_about_a_standing_foot(joint: str, axis: int) -> None:
    robot = rr.load_robot("op3")
    _, tilt = gain_matrices(robot, Balance(joints={joint: JointGain(tilt=1.0)}))
    lean = np.zeros(2)
    lean[axis] = 0.1
    data = mujoco.MjData(robot.model)
    data.qpos[:] = robot.standing()
    side = joint[0]
    foot = robot.model.body(f"{side}_ank_roll_link").id
    trunks = []
    for addition in (np.zeros(len(robot.joint_names)), tilt @ lean):
        data.qpos[robot.qpos_index] = robot.standing()[robot.qpos_index] + addition
        mujoco.mj_kinematics(robot.model, data)
        of_foot = data.xmat[foot].reshape(3, 3)
        trunks.append(of_foot.T @ data.xmat[robot.root_body].reshape(3, 3))
    turned = Rotation.from_matrix(trunks[1] @ trunks[0].T).as_rotvec()
    assert np.allclose(turned, -np.eye(3)[axis] * 0.1, atol=1e-3)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_lean_of_the_joints_turns_the_trunk_and_leaves_the_feet(axis: int) -> None:
    robot, angle = rr.load_robot("op3"), 0.01
    joints = robot.standing()
    joints[robot.qpos_index] += angle * lean_over_feet(robot, robot.standing())[:, axis]
    data = mujoco.MjData(robot.model)
    feet = [robot.model.body(f"{side}_ank_roll_link").id for side in "lr"]
    gaps = []
    for qpos in (robot.standing(), joints):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(robot.model, data)
        gaps.append([data.xpos[feet[1]] - data.xpos[feet[0]], data.xmat[feet].copy()])
    turned = Rotation.from_matrix(gaps[1][1].reshape(2, 3, 3) @ gaps[0][1].reshape(2, 3, 3).transpose(0, 2, 1))
    assert np.allclose(turned.as_rotvec(), -angle * np.eye(3)[axis], atol=2e-4)
    expected = turned[0].apply(gaps[0][0])
    assert np.allclose(gaps[1][0], expected, atol=1e-4)


def test_no_lean_changes_no_goal() -> None:
    law, plan = Law(feedback(), DT), np.array([0.1, 0.2, 0.3])
    for row in range(50):
        assert np.allclose(law.step(row, plan, STILL), plan, atol=1e-12)


def test_a_leg_whose_foot_is_in_the_air_is_left_as_planned() -> None:
    """There its ankle would turn the foot, not the trunk."""
    air = np.zeros((50, 2))
    air[20:, 1] = 1.0
    law = Law(feedback(legs=np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]), air=air, fade=0.01, fusion=0.05), DT)
    found = np.array([law.step(row, np.zeros(3), leaning(0.05, 0.05)) for row in range(50)])
    assert np.allclose(found[19], 0.1, atol=1e-3)
    assert np.allclose(found[49], [0.1, 0.0, 0.1], atol=1e-3)


@pytest.mark.parametrize("name", ["op3", "toddler_class"])
def test_each_leg_has_the_joints_that_carry_its_foot_alone(name: str) -> None:
    robot = rr.load_robot(name)
    legs, words = joints_of_legs(robot), ("hip", "knee", "ank")
    side = [next((k for k, s in enumerate("lr") if joint.startswith(s)), None) for joint in robot.joint_names]
    expected = [[float(side[k] == foot and any(w in joint for w in words)) for foot in range(2)]
                for k, joint in enumerate(robot.joint_names)]  # fmt: skip
    assert legs.tolist() == expected


def test_a_foot_is_planned_in_the_air_where_its_sole_is_off_the_ground() -> None:
    robot = rr.load_robot("op3")
    leg = robot.qpos_index[[robot.joint_names.index(f"l_{name}") for name in ("hip_pitch", "knee", "ank_pitch")]]
    qpos = np.tile(robot.standing(), (3, 1))
    qpos[1:, leg] += [-0.3, 0.6, 0.3]
    qpos[2, robot.root_address + 2] += 0.05
    plan = Trajectory(qpos, 1.0, robot.joint_names, robot.name)
    goals = Goals(qpos[:, robot.qpos_index], 1.0, 0.0, 0.0)
    assert planned_air(robot, plan, goals).tolist() == [[0, 0], [1, 0], [1, 1]]


def test_the_reference_is_that_of_the_row_the_reading_is_from() -> None:
    reference = np.zeros((50, 4))
    reference[10:, 1] = 0.1
    law = Law(feedback(reference=reference, lag=3, fade=0.01, fusion=0.05), DT)
    for row in range(50):
        law.step(row, np.zeros(3), leaning(0.0, 0.1))
        assert np.isclose(law.excess[1], 0.0 if row >= 13 else 0.1)


def test_additions_keep_their_bounds_and_goals_keep_range_and_speed() -> None:
    random, limits = np.random.default_rng(1), feedback(bound=0.15, speed=2.0, top_speed=3.0)
    law, last = Law(limits, DT), None
    plan = np.array([0.95, -0.95, 0.0])
    for row in range(300):
        before = law.added.copy()
        goal = law.step(row, plan, Reading(random.normal(0, 20, 3), random.normal(0, 20, 3)))
        assert (np.abs(law.added) <= 0.15 + 1e-12).all() and (np.abs(law.added - before) <= 2.0 * DT + 1e-12).all()
        assert (goal >= -1).all() and (goal <= 1).all()
        assert last is None or (np.abs(goal - last) <= 3.0 * DT + 1e-12).all()
        last = goal


def test_a_reading_that_is_not_finite_changes_nothing() -> None:
    laws, found = [Law(feedback(), DT) for _ in range(2)], [np.zeros(3)]
    for row in range(40):
        reading = leaning(0.05, -0.02)
        found = [law.step(row, np.zeros(3), reading) for law in laws]
        if row == 20:
            for wrong in (Reading(np.array([0.0, np.nan, 0.0]), STILL.accel), Reading(np.zeros(3), np.full(3, np.inf))):
                laws[1].step(row, np.zeros(3), wrong)
    assert np.array_equal(found[0], found[1]) and np.abs(found[0]).max() > 0.01


def test_without_trust_additions_fade_out_and_stay_out() -> None:
    law = Law(feedback(fade=0.2), DT)
    for row in range(40):
        law.step(row, np.zeros(3), leaning(0.1, 0.1))
    assert np.abs(law.added).max() > 0.05
    law.trusted = False
    goals = [law.step(row, np.zeros(3), None) for row in range(round(0.2 / DT) + 2)]
    assert np.allclose(goals[-1], 0.0)


def test_a_fall_goes_to_the_crouch_no_faster_than_additions() -> None:
    law = Law(feedback(crouch=np.array([0.5, -0.5, 0.2]), fusion=0.05), DT)
    law.step(0, np.zeros(3), leaning(0.0, 0.6))
    assert law.stopped
    goals = np.array([law.step(row, np.zeros(3), leaning(0.0, 0.0)) for row in range(60)])
    assert np.allclose(goals[-1], [0.5, -0.5, 0.2]) and np.abs(np.diff(goals, axis=0)).max() <= 3.0 * DT + 1e-9


def test_a_virtual_sensor_is_late_biased_noisy_and_saturates() -> None:
    imu = Imu(delay=0.016, gyro_noise=0.0, accel_noise=0.0, gyro_bias=0.05, accel_bias=0.2, gyro_range=1.0)
    sensor = VirtualImu(imu, DT, seed=3)
    spins = np.linspace(0, 5, 100)
    found = np.array([sensor.read(Reading(np.full(3, s), STILL.accel)).gyro for s in spins])
    assert np.abs(found).max() == 1.0
    assert np.allclose(found[10] - found[9], spins[1], atol=1e-9)
    bias = found[10] - spins[8]
    assert (np.abs(bias) <= 0.05).all() and np.abs(bias).max() > 0
    again = VirtualImu(imu, DT, seed=3)
    assert np.allclose(again.read(Reading(np.full(3, spins[0]), STILL.accel)).gyro, found[0])


def test_the_law_of_other_joints_is_the_same_law() -> None:
    one, order = feedback(lower=np.array([-1.0, -2.0, -3.0])), [2, 0, 1]
    plan, reading = np.array([0.1, 0.2, 0.3]), leaning(0.1, -0.1)
    whole, part = Law(one, DT), Law(one.of(order), DT)
    assert np.allclose(whole.step(0, plan, reading)[order], part.step(0, plan[order], reading))


def test_feedback_survives_the_trajectory_file() -> None:
    one = feedback()
    other = read_feedback(one.arrays())
    assert other is not None and other.lag == one.lag and np.array_equal(other.reference, one.reference)
    arrays = one.arrays()
    earlier = read_feedback({key: value for key, value in arrays.items() if key not in SWING})
    assert earlier is not None and not earlier.air.any() and not earlier.legs.any()
    arrays.pop("feedback_tilt")
    with pytest.raises(TrajectoryError, match="no 'feedback_tilt'"):
        read_feedback(arrays)
    with pytest.raises(TrajectoryError, match="feedback_rate must be finite"):
        feedback(rate=np.full((3, 2), np.nan))


def test_a_map_with_a_sensor_is_read_back_as_written(tmp_path) -> None:
    servo_map = load_map("op3")
    assert servo_map.imu is not None and servo_map.balance is not None
    path = tmp_path / "map.toml"
    path.write_text(dump_map(servo_map))
    assert load_map(path) == servo_map


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ('[imu]\naxes = ["x", "x", "z"]', r"axes .* are not x, y and z"),
        ('[imu]\naxes = ["x", "y", "-z"]', "mirror image"),
        ("[imu]\nid = 3", "id 3 of a servo"),
        ("[imu]\ngyro_noise = -1", "gyro_noise"),
        ("[imu]\n[balance.joints]\nno_joint = { rate = 0.1 }", "'no_joint', which is not among the joints"),
        ("[imu]\n[balance.joints]\nl_knee = { speed = 0.1 }", "l_knee cannot be"),
        ("[imu]\n[balance.joints]\nl_knee = { rate = 7.0 }", "rate 7"),
        ("[balance]\nbound = 0.1", r"\[balance\] needs an \[imu\]"),
    ],
)
def test_a_wrong_sensor_or_gain_is_refused_with_its_place(written: str, message: str, tmp_path) -> None:
    servos = dump_map(load_map("op3")).partition("[servo.")
    head = servos[0].partition("[imu]")[0]
    path = tmp_path / "map.toml"
    path.write_text(f"{head}\n{written}\n\n{servos[1]}{servos[2]}")
    with pytest.raises(ServoError, match=message):
        load_map(path)
