"""The part of MuJoCo's compiled modules that the package uses: sizes, arrays and functions with their types.

MuJoCo ships no stubs. A field that is missing here is added with the type that MuJoCo documents. Rendering is not typed.
"""

from collections.abc import Callable, Iterator
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Ints = NDArray[np.int32]
Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]

class FatalError(Exception): ...

class mjtBias(IntEnum):
    mjBIAS_NONE = 0
    mjBIAS_AFFINE = 1

class mjtBuiltin(IntEnum):
    mjBUILTIN_GRADIENT = 1
    mjBUILTIN_CHECKER = 2

class mjtCatBit(IntEnum):
    mjCAT_ALL = 7

class mjtConstraint(IntEnum):
    mjCNSTR_FRICTION_DOF = 1

class mjtDisableBit(IntEnum):
    mjDSBL_CONSTRAINT = 1
    mjDSBL_EQUALITY = 2
    mjDSBL_FRICTIONLOSS = 4
    mjDSBL_LIMIT = 8
    mjDSBL_CONTACT = 16
    mjDSBL_ACTUATION = 2048
    mjDSBL_AUTORESET = 65536

class mjtFontScale(IntEnum):
    mjFONTSCALE_100 = 100

class mjtFramebuffer(IntEnum):
    mjFB_OFFSCREEN = 1

class mjtGain(IntEnum):
    mjGAIN_FIXED = 0

class mjtGeom(IntEnum):
    mjGEOM_PLANE = 0
    mjGEOM_HFIELD = 1
    mjGEOM_SPHERE = 2
    mjGEOM_CAPSULE = 3
    mjGEOM_ELLIPSOID = 4
    mjGEOM_CYLINDER = 5
    mjGEOM_BOX = 6
    mjGEOM_MESH = 7

class mjtIntegrator(IntEnum):
    mjINT_IMPLICIT = 2
    mjINT_IMPLICITFAST = 3

class mjtJacobian(IntEnum):
    mjJAC_DENSE = 0

class mjtJoint(IntEnum):
    mjJNT_FREE = 0
    mjJNT_BALL = 1
    mjJNT_SLIDE = 2
    mjJNT_HINGE = 3

class mjtLightType(IntEnum):
    mjLIGHT_DIRECTIONAL = 1

class mjtLimited(IntEnum):
    mjLIMITED_TRUE = 1

class mjtObj(IntEnum):
    mjOBJ_BODY = 1
    mjOBJ_XBODY = 2
    mjOBJ_JOINT = 3
    mjOBJ_SITE = 6

class mjtOrientation(IntEnum):
    mjORIENTATION_QUAT = 0

class mjtTexture(IntEnum):
    mjTEXTURE_2D = 0
    mjTEXTURE_SKYBOX = 2

class mjtTextureRole(IntEnum):
    mjTEXROLE_RGB = 1

class mjtTrn(IntEnum):
    mjTRN_JOINT = 0

class mjtWrap(IntEnum):
    mjWRAP_JOINT = 1

class MjOption:
    cone: int
    disableflags: int
    impratio: float
    integrator: int
    iterations: int
    jacobian: int
    solver: int
    gravity: Floats
    timestep: float
    tolerance: float

class MjStatistic:
    center: Floats
    extent: float

class _Named:
    """An element by its name: views of its rows in the arrays of a model or of data."""

    id: int
    name: str

class _ModelBody(_Named):
    inertia: Floats
    ipos: Floats
    mass: Floats
    pos: Floats
    quat: Floats
    subtreemass: Floats

class _ModelJoint(_Named):
    armature: Floats
    axis: Floats
    damping: Floats
    pos: Floats
    qpos0: Floats
    range: Floats
    type: Ints
    limited: Bytes

class _ModelGeom(_Named):
    conaffinity: Ints
    contype: Ints
    type: Ints
    friction: Floats
    pos: Floats
    quat: Floats
    size: Floats

class _ModelSite(_Named):
    type: Ints
    pos: Floats
    quat: Floats
    size: Floats

class _ModelActuator(_Named):
    forcelimited: Bytes
    forcerange: Floats
    gear: Floats

class _ModelKey(_Named):
    act: Floats
    ctrl: Floats
    qpos: Floats
    qvel: Floats
    time: Floats

class MjModel:
    body_mocapid: Ints
    body_geomadr: Ints
    hfield_adr: Ints
    hfield_data: Floats
    hfield_ncol: Ints
    hfield_nrow: Ints
    hfield_size: Floats
    actuator_biasprm: Floats
    actuator_ctrlrange: Floats
    actuator_forcerange: Floats
    actuator_gainprm: Floats
    actuator_gear: Floats
    body_inertia: Floats
    body_ipos: Floats
    body_margin: Floats
    body_mass: Floats
    body_pos: Floats
    body_quat: Floats
    body_subtreemass: Floats
    dof_armature: Floats
    dof_damping: Floats
    dof_frictionloss: Floats
    geom_aabb: Floats
    geom_friction: Floats
    geom_gap: Floats
    geom_margin: Floats
    geom_pos: Floats
    geom_quat: Floats
    geom_rbound: Floats
    geom_size: Floats
    geom_solimp: Floats
    geom_solref: Floats
    jnt_actfrcrange: Floats
    jnt_axis: Floats
    jnt_pos: Floats
    jnt_range: Floats
    key_qpos: Floats
    key_time: Floats
    pair_friction: Floats
    pair_gap: Floats
    pair_margin: Floats
    qpos0: Floats
    tendon_range: Floats
    wrap_prm: Floats
    actuator_biastype: Ints
    actuator_gaintype: Ints
    actuator_trnid: Ints
    actuator_trntype: Ints
    body_conaffinity: Ints
    body_contype: Ints
    body_dofadr: Ints
    body_dofnum: Ints
    body_jntadr: Ints
    body_jntnum: Ints
    body_parentid: Ints
    body_rootid: Ints
    body_weldid: Ints
    body_geomnum: Ints
    dof_bodyid: Ints
    dof_jntid: Ints
    exclude_signature: Ints
    geom_bodyid: Ints
    geom_conaffinity: Ints
    geom_condim: Ints
    geom_priority: Ints
    geom_contype: Ints
    geom_dataid: Ints
    geom_group: Ints
    geom_matid: Ints
    geom_type: Ints
    jnt_bodyid: Ints
    jnt_dofadr: Ints
    jnt_qposadr: Ints
    jnt_type: Ints
    mesh_face: Ints
    mesh_faceadr: Ints
    mesh_facenum: Ints
    mesh_graph: Ints
    mesh_graphadr: Ints
    mesh_vertadr: Ints
    mesh_vertnum: Ints
    pair_dim: Ints
    pair_geom1: Ints
    pair_geom2: Ints
    tendon_adr: Ints
    tendon_num: Ints
    wrap_objid: Ints
    wrap_type: Ints
    actuator_ctrllimited: Bools
    actuator_forcelimited: Bools
    eq_active0: Bools
    eq_obj1id: Ints
    eq_type: Ints
    jnt_actfrclimited: Bools
    jnt_limited: Bools
    tendon_limited: Bools
    geom_rgba: Singles
    mat_rgba: Singles
    mesh_vert: Singles
    names: bytes
    nbody: int
    neq: int
    ngeom: int
    njnt: int
    nkey: int
    nlight: int
    nmat: int
    nmesh: int
    nq: int
    nsite: int
    nu: int
    nv: int
    opt: MjOption
    stat: MjStatistic
    vis: Any
    @staticmethod
    def from_xml_path(filename: str, assets: dict[str, bytes] | None = None) -> MjModel: ...
    @staticmethod
    def from_binary_path(filename: str, assets: dict[str, bytes] | None = None) -> MjModel: ...
    @staticmethod
    def from_xml_string(xml: str, assets: dict[str, bytes] | None = None) -> MjModel: ...
    def actuator(self, name: str | int) -> _ModelActuator: ...
    def body(self, name: str | int) -> _ModelBody: ...
    def geom(self, name: str | int) -> _ModelGeom: ...
    def joint(self, name: str | int) -> _ModelJoint: ...
    def key(self, name: str | int) -> _ModelKey: ...
    def mesh(self, name: str | int) -> _Named: ...
    def site(self, name: str | int) -> _ModelSite: ...

class _DataBody(_Named):
    cvel: Floats
    subtree_angmom: Floats
    subtree_com: Floats
    subtree_linvel: Floats
    xfrc_applied: Floats
    ximat: Floats
    xipos: Floats
    xmat: Floats
    xpos: Floats
    xquat: Floats

class _DataJoint(_Named):
    cdof: Floats
    qacc: Floats
    qfrc_actuator: Floats
    qfrc_applied: Floats
    qfrc_bias: Floats
    qfrc_constraint: Floats
    qfrc_inverse: Floats
    qpos: Floats
    qvel: Floats
    xanchor: Floats
    xaxis: Floats

class _DataGeom(_Named):
    xmat: Floats
    xpos: Floats

class _DataSite(_Named):
    xmat: Floats
    xpos: Floats

class _Contact:
    dim: int
    dist: float
    efc_address: int
    frame: Floats
    friction: Floats
    geom: Ints
    geom1: int
    geom2: int
    pos: Floats

class _Contacts:
    """All contacts of a moment: one row a contact."""

    dist: Floats
    frame: Floats
    friction: Floats
    pos: Floats
    efc_address: Ints
    geom: Ints
    def __len__(self) -> int: ...
    def __getitem__(self, index: int) -> _Contact: ...
    def __iter__(self) -> Iterator[_Contact]: ...

class MjData:
    def __init__(self, model: MjModel) -> None: ...
    mocap_pos: Floats
    mocap_quat: Floats
    M: Floats
    actuator_force: Floats
    actuator_length: Floats
    actuator_velocity: Floats
    cdof: Floats
    ctrl: Floats
    cvel: Floats
    efc_J: Floats
    efc_force: Floats
    efc_pos: Floats
    geom_xmat: Floats
    geom_xpos: Floats
    light_xpos: Floats
    qacc: Floats
    qfrc_actuator: Floats
    qfrc_applied: Floats
    qfrc_bias: Floats
    qfrc_constraint: Floats
    qfrc_inverse: Floats
    qpos: Floats
    qvel: Floats
    sensordata: Floats
    site_xmat: Floats
    site_xpos: Floats
    subtree_angmom: Floats
    subtree_com: Floats
    subtree_linvel: Floats
    ten_length: Floats
    xanchor: Floats
    xaxis: Floats
    xfrc_applied: Floats
    ximat: Floats
    xipos: Floats
    xmat: Floats
    xpos: Floats
    xquat: Floats
    efc_id: Ints
    efc_type: Ints
    ncon: int
    ne: int
    time: float
    @property
    def contact(self) -> _Contacts: ...
    @property
    def model(self) -> MjModel: ...
    @property
    def warning(self) -> Any: ...
    def body(self, name: str | int) -> _DataBody: ...
    def geom(self, name: str | int) -> _DataGeom: ...
    def joint(self, name: str | int) -> _DataJoint: ...
    def site(self, name: str | int) -> _DataSite: ...

class MjsOrientation:
    axisangle: Floats
    euler: Floats
    type: Any
    xyaxes: Floats
    zaxis: Floats

class MjsCompiler:
    degree: bool
    meshdir: str
    texturedir: str

class MjsGeom:
    conaffinity: int
    contype: int
    friction: Floats
    fromto: Floats
    pos: Floats
    quat: Floats
    size: Floats
    margin: float
    mass: float
    hfieldname: str
    meshname: str
    name: str
    alt: MjsOrientation
    parent: MjsBody
    type: Any
    def __getattr__(self, name: str) -> Any: ...

class MjsJoint:
    armature: float
    ref: float
    axis: Floats
    damping: Floats
    pos: Floats
    range: Floats
    stiffness: Floats
    id: int
    name: str
    actfrclimited: Any
    limited: Any
    parent: MjsBody
    type: Any

class MjsActuator:
    forcerange: Floats
    gear: Floats
    name: str
    target: str
    def __getattr__(self, name: str) -> Any: ...

class MjsBody:
    id: int
    inertia: Floats
    ipos: Floats
    pos: Floats
    quat: Floats
    name: str
    mass: float
    alt: MjsOrientation
    bodies: list[MjsBody]
    geoms: list[MjsGeom]
    joints: list[MjsJoint]
    lights: list[Any]
    parent: MjsBody
    sites: list[Any]
    def add_freejoint(self, **values: Any) -> MjsJoint: ...
    def add_geom(self, default: Any = None, **values: Any) -> MjsGeom: ...
    def add_joint(self, default: Any = None, **values: Any) -> MjsJoint: ...
    def add_light(self, default: Any = None, **values: Any) -> Any: ...
    def add_site(self, default: Any = None, **values: Any) -> Any: ...
    def __getattr__(self, name: str) -> Any: ...

class MjSpec:
    meshdir: str
    texturedir: str
    actuators: list[MjsActuator]
    bodies: list[MjsBody]
    compiler: MjsCompiler
    geoms: list[MjsGeom]
    joints: list[MjsJoint]
    option: MjOption
    stat: MjStatistic
    worldbody: MjsBody
    @staticmethod
    def from_file(filename: str, **values: Any) -> MjSpec: ...
    @staticmethod
    def from_string(xml: str, **values: Any) -> MjSpec: ...
    def body(self, name: str) -> MjsBody: ...
    def compile(self) -> MjModel: ...
    def copy(self) -> MjSpec: ...
    def geom(self, name: str) -> MjsGeom: ...
    def joint(self, name: str) -> MjsJoint: ...
    def to_xml(self) -> str: ...
    def __getattr__(self, name: str) -> Any: ...

def mj_camlight(m: MjModel, d: MjData) -> None: ...
def mj_collision(m: MjModel, d: MjData) -> None: ...
def mj_comPos(m: MjModel, d: MjData) -> None: ...
def mj_comVel(m: MjModel, d: MjData) -> None: ...
def mj_forward(m: MjModel, d: MjData) -> None: ...
def mj_fwdPosition(m: MjModel, d: MjData) -> None: ...
def mj_fwdVelocity(m: MjModel, d: MjData) -> None: ...
def mj_inverse(m: MjModel, d: MjData) -> None: ...
def mj_kinematics(m: MjModel, d: MjData) -> None: ...
def mj_makeConstraint(m: MjModel, d: MjData) -> None: ...
def mj_setConst(m: MjModel, d: MjData) -> None: ...
def mj_subtreeVel(m: MjModel, d: MjData) -> None: ...
def mj_contactForce(m: MjModel, d: MjData, id: int, result: Floats) -> None: ...
def mj_differentiatePos(m: MjModel, qvel: Floats, dt: float, qpos1: Floats, qpos2: Floats) -> None: ...
def mj_geomDistance(m: MjModel, d: MjData, geom1: int, geom2: int, distmax: float, fromto: Floats | None) -> float: ...
def mj_integratePos(m: MjModel, qpos: Floats, qvel: Floats, dt: float) -> None: ...
def mj_jac(m: MjModel, d: MjData, jacp: Floats | None, jacr: Floats | None, point: Floats, body: int) -> None: ...
def mj_jacBody(m: MjModel, d: MjData, jacp: Floats | None, jacr: Floats | None, body: int) -> None: ...
def mj_jacSubtreeCom(m: MjModel, d: MjData, jacp: Floats | None, body: int) -> None: ...
def mj_mulM(m: MjModel, d: MjData, res: Floats, vec: Floats) -> None: ...
def mj_name2id(m: MjModel, type: Any, name: str) -> int: ...
def mj_objectVelocity(m: MjModel, d: MjData, objtype: Any, objid: int, res: Floats, flg_local: int) -> None: ...
def mj_resetDataKeyframe(m: MjModel, d: MjData, key: int) -> None: ...
def mj_step(m: MjModel, d: MjData, nstep: int = 1) -> None: ...
def mju_mat2Quat(quat: Floats, mat: Floats) -> None: ...
def mju_mulQuat(res: Floats, quat1: Floats, quat2: Floats) -> None: ...
def mju_quat2Mat(res: Floats, quat: Floats) -> None: ...
def mju_rotVecQuat(res: Floats, vec: Floats, quat: Floats) -> None: ...
def get_mju_user_warning() -> Callable[[str], None] | None: ...
def set_mju_user_warning(handler: Callable[[str], None] | None) -> None: ...
def __getattr__(name: str) -> Any: ...
