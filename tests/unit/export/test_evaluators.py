"""Evaluators of simulator targets against numbers that the targets themselves publish."""

import numpy as np
import pytest

from tests.support.targets import gazebo, holoocean, mss, mujoco_body, pvs, sitl, stonefish, uuv
from tests.support.targets.frames import FLIP, FLIP6, Body, coriolis, down, push, rigid_body
from tests.support.targets.models import states
from tests.support.targets.motion import move

REST = np.zeros((1, 6))


def sdf(inertial: str = "", link: str = "", plugin: str = "", world: str = "") -> str:
    """Return a world with one link under the Hydrodynamics system."""
    return f"""<sdf version="1.9"><world name="w">{world}<model name="m">
      <link name="base"><inertial>{inertial}</inertial>{link}</link>
      <plugin name="gz::sim::systems::Hydrodynamics"><link_name>base</link_name>{plugin}</plugin>
      </model></world></sdf>"""


@pytest.mark.parametrize(
    ("share", "position", "angle", "linear", "angular"),
    [
        (
            1.0,
            (0.1615036362557803, 0.10710173528687592, -0.0024940422102210013),
            0.31351100787675423,
            (0.32087488227940963, 0.212772641112832, -0.010283659814296216),
            (0.0031500380024329826, 0.0022451901112414984, -0.052564274312245286),
        ),
        (
            10.0,
            (0.0616809222579082, 0.020951194425796703, -0.0006836779301496875),
            0.2990323477528498,
            (0.12296544056644206, 0.04157265120194949, -0.002832810385198371),
            (0.0017159692398096078, 0.00022402938638815302, -0.014274584996716126),
        ),
    ],
)
def test_gazebo_moves_an_ellipsoid_with_fluid_added_mass(
    share: float, position: object, angle: float, linear: object, angular: object
) -> None:
    """gz-sim 93bbf3ed1 test/integration/added_mass.cc:79-150, body1 and body3, one second."""
    text = f"""<mass>1073.3774899765126</mass><inertia><ixx>107.33774899765126</ixx>
      <iyy>268.34437249412815</iyy><izz>268.34437249412815</izz></inertia><fluid_added_mass>
      <xx>{236.14304779483277 * share}</xx><yy>{901.6370915802705 * share}</yy>
      <zz>{901.6370915802705 * share}</zz><qq>{64.40264939859075 * share}</qq>
      <rr>{64.40264939859075 * share}</rr></fluid_added_mass>"""
    body = gazebo.parse(sdf(text, world="<gravity>0 0 0</gravity>"))

    def wrench(t: float, turn: np.ndarray) -> np.ndarray:
        up = np.array([[2000.0, 2000.0, 0.0]]) * np.sin(3 * np.pi * t)
        torque = np.array([[200.0, 200.0, 0.0]]) * np.sin(2 * np.pi * t)
        return np.hstack([up @ FLIP @ turn, torque @ FLIP @ turn])[0]

    place, turn, nu = move(body, np.zeros(6), np.eye(3), 0.01, 100, wrench)
    # half of the tolerances of that test, which integrates by 1 ms
    np.testing.assert_allclose(FLIP @ place, position, atol=5e-4)
    assert np.arccos((np.trace(turn) - 1) / 2) == pytest.approx(angle, abs=5e-6)
    np.testing.assert_allclose(FLIP @ turn @ nu[:3], linear, atol=1e-5)
    np.testing.assert_allclose(FLIP @ turn @ nu[3:], angular, atol=5e-5)


def flu(body: Body, *state: float) -> np.ndarray:
    """Return the force in FLU of a state in FLU at rest."""
    return FLIP6 @ body.force(np.array([state]) @ FLIP6, REST)[0]


def test_gazebo_has_the_forces_of_its_unit_test() -> None:
    """gz-sim 93bbf3ed1 src/systems/hydrodynamics/Hydrodynamics_TEST.cc: Munk, damping."""
    still = "<gravity>0 0 0</gravity>"
    light = "<mass>1e-12</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz></inertia>"
    munk = "<xDotU>-5</xDotU><yDotV>-100</yDotV><zDotW>-100</zDotW><mDotQ>-10</mDotQ>"
    body = gazebo.parse(sdf(light, plugin=munk, world=still))
    # CoriolisForceDirection
    assert flu(body, 1, 0.5, 0, 0, 0, 0)[5] == pytest.approx(-47.5)
    assert body.inertia[1, 1] == pytest.approx(100)
    # DampingMatrixCombined: 25.3128 against the motion; -94.2475 u u pushes on one side
    combined = "<xU>-0.2</xU><xUabsU>-6.2282</xUabsU>"
    body = gazebo.parse(sdf(light, plugin=combined, world=still))
    assert flu(body, 2, 0, 0, 0, 0, 0)[0] == pytest.approx(-25.3128)
    assert flu(body, -2, 0, 0, 0, 0, 0)[0] == pytest.approx(25.3128)
    body = gazebo.parse(sdf(light, plugin="<xUU>-94.2475</xUU>", world=still))
    assert flu(body, -2, 0, 0, 0, 0, 0)[0] == pytest.approx(-376.99)
    # DampingMatrixCrossTerm: 15 against surge by sway
    body = gazebo.parse(sdf(light, plugin="<xUV>-5</xUV>", world=still))
    assert flu(body, 1, 3, 0, 0, 0, 0)[0] == pytest.approx(-15)


def test_gazebo_floats_the_tethys_box() -> None:
    """gz-sim 93bbf3ed1 tutorials/.../my_lrauv/model.sdf: 147.8671 kg in a box of that water."""
    box = "<geometry><box><size>2 0.3 0.2464451666666667</size></box></geometry>"
    text = sdf(
        "<mass>147.8671</mass>",
        f'<collision name="c"><pose>0 0 0.1 0 0 0</pose>{box}</collision>',
        world='<plugin name="gz::sim::systems::Buoyancy"/>',
    )
    heel = np.array([[0, 0, 0, 0.2, 0, 0]])
    force = gazebo.parse(text).force(REST, heel)[0]
    np.testing.assert_allclose(force[:3], 0, atol=1e-9)
    assert force[3] == pytest.approx(-147.8671 * 9.8 * 0.1 * np.sin(0.2))


REXROV = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro" name="rexrov">
  <xacro:property name="mass" value="1862.87"/>
  <xacro:property name="cob" value="0.0 0.0 0.3"/>
  <link name="base_link"><inertial><mass value="${mass}"/><origin xyz="0 0 0"/>
    <inertia ixx="525.39" ixy="1.44" ixz="33.41" iyy="794.20" iyz="2.6" izz="691.23"/>
  </inertial></link>
  <gazebo><plugin name="p" filename="libuuv_underwater_object_ros_plugin.so">
    <fluid_density>1028.0</fluid_density>
    <link name="base_link"><volume>1.83826</volume>
      <center_of_buoyancy>${cob}</center_of_buoyancy>
      <hydrodynamic_model><type>fossen</type>
        <added_mass>779.79 -6.8773 -103.32 8.5426 -165.54 -7.8033
          -6.8773 1222 51.29 409.44 -5.8488 62.726
          -103.32 51.29 3659.9 6.1112 -386.42 10.774
          8.5426 409.44 6.1112 534.9 -10.027 21.019
          -165.54 -5.8488 -386.42 -10.027 842.69 -1.1162
          -7.8033 62.726 10.775 21.019 -1.1162 224.32</added_mass>
        <linear_damping>-74.82 -69.48 -728.4 -268.8 -309.77 -105</linear_damping>
        <quadratic_damping>-748.22 -992.53 -1821.01 -672 -774.44 -523.27</quadratic_damping>
      </hydrodynamic_model></link></plugin></gazebo></robot>"""


def test_uuv_simulator_has_the_rexrov() -> None:
    """uuv_simulator bfb40cb1 uuv_descriptions/urdf/rexrov.gazebo.xacro, rexrov_base.xacro.

    By hand: surge 1 m/s brakes by 74.82 + 748.22 N; buoyancy 1.83826 * 1028 * 9.8 N acts
    0.3 m above the centre of mass; the added mass is in FRD, the tensor in FLU.
    """
    body = uuv.parse(REXROV)
    buoyancy, weight = 1.83826 * 1028 * 9.8, 1862.87 * 9.8
    heel = np.array([[0, 0, 0, 0.1, 0, 0]])
    force = body.force(np.array([[1.0, 0, 0, 0, 0, 0]]), heel)[0]
    assert force[0] == pytest.approx(-823.04)
    assert force[1] == pytest.approx((weight - buoyancy) * np.sin(0.1))
    assert force[3] == pytest.approx(-0.3 * buoyancy * np.sin(0.1))
    # Munk: moment in pitch of the off-diagonal added mass, -103.32 at 1 m/s
    assert force[4] == pytest.approx(-103.32)
    assert body.inertia[1, 3] == 409.44
    assert body.inertia[0, 4] == -165.54
    assert body.inertia[3, 4] == pytest.approx(-10.027 - 1.44)


def test_uuv_simulator_applies_the_force_at_the_centre_of_mass() -> None:
    """gazebo-classic 0127272 gazebo/physics/ode/ODELink.cc, AddRelativeForce: dBodyAddRelForce.

    With the centre of mass 0.1 m above the link's origin, drag of 823.04 N astern gives a
    moment of 82.304 N m that lifts the bow.
    """
    body = uuv.parse(REXROV.replace('xyz="0 0 0"', 'xyz="0 0 0.1"'))
    drag = body.force(np.array([[1.0, 0, 0, 0, 0, 0]]), REST)[0]
    assert drag[4] == pytest.approx(82.304 - 103.32)


def test_uuv_simulator_counts_forward_damping_with_its_sign() -> None:
    """uuv_simulator bfb40cb1 HydrodynamicModel.cc:463-489: all coefficients 1, surge 1 m/s."""
    text = REXROV.replace(
        "<linear_damping>",
        "<linear_damping_forward_speed>1 1 1 1 1 1</linear_damping_forward_speed><linear_damping>",
    )
    force = uuv.parse(text).force(np.array([[2.0, 0.5, 0, 0, 0, 0]]), REST)[0]
    plain = uuv.parse(REXROV).force(np.array([[2.0, 0.5, 0, 0, 0, 0]]), REST)[0]
    np.testing.assert_allclose((force - plain)[:2], [4.0, 1.0])


CRAFT_PY = """
import numpy as np
from python_vehicle_simulator.lib.gnc import gvect, m2c

class craft:
    def __init__(self):
        self.M = np.diag([32.0, 60.0, 60.0, 0.2, 8.0, 8.0])
        self.M[0, 4] = self.M[4, 0] = 0.6
        self.M[1, 3] = self.M[3, 1] = -0.6

    def dynamics(self, eta, nu, u_actual, u_control, sampleTime):
        damping = np.array([20.0, 90.0, 90.0, 1.0, 9.0, 9.0]) * nu
        g = gvect(300.0, 310.0, eta[4], eta[3], np.array([0.0, 0.0, 0.02]), np.zeros(3))
        force = u_control - m2c(self.M, nu) @ nu - damping - g
        return nu + sampleTime * np.linalg.solve(self.M, force), u_control
"""

CRAFT_M = """
function [xdot, tau] = craft(x, tau)
M = diag([32 60 60 0.2 8 8]); M(1,5) = 0.6; M(5,1) = 0.6; M(2,4) = -0.6; M(4,2) = -0.6;
nu = x(1:6); f = x(10); t = x(11); p = x(12);
a = M * nu; S = @(a) [0 -a(3) a(2); a(3) 0 -a(1); -a(2) a(1) 0];
C = [zeros(3) -S(a(1:3)); -S(a(1:3)) -S(a(4:6))];
R = [cos(p)*cos(t) cos(p)*sin(t)*sin(f)-sin(p)*cos(f) sin(p)*sin(f)+cos(p)*cos(f)*sin(t)
     sin(p)*cos(t) cos(p)*cos(f)+sin(f)*sin(t)*sin(p) sin(t)*sin(p)*cos(f)-cos(p)*sin(f)
     -sin(t) cos(t)*sin(f) cos(t)*cos(f)];
T = [1 sin(f)*tan(t) cos(f)*tan(t); 0 cos(f) -sin(f); 0 sin(f)/cos(t) cos(f)/cos(t)];
g = -[(300-310)*R(3,:)'; cross([0;0;0.02], 300*R(3,:)')];
nu_dot = M \\ (tau - C*nu - [20;90;90;1;9;9].*nu - g);
xdot = [nu_dot; R*nu(1:3); T*nu(4:6)];
end
"""


def test_python_vehicle_simulator_loop_ends_where_the_package_ends(tmp_path: object) -> None:
    """PythonVehicleSimulator c717e07, simulate(100, 0.02, craft()) of lib/mainLoop.py run there.

    The package's m2c, gvect and attitudeEuler made these numbers, row 100 of its table.
    """
    (tmp_path / "craft.py").write_text(CRAFT_PY)  # type: ignore[operator]
    craft = pvs.vehicle(tmp_path, "craft")  # type: ignore[arg-type]
    start, tau = np.array([1.0, 0.2, -0.1, 0.05, 0.02, -0.3]), np.array([9.0, 0, 0, 0, 0, 1])
    table = pvs.simulate(craft, 101, 0.02, start, tau)
    published = [
        [1.3695369179396086, -0.12530359279197018, -0.1352113753824697],
        [-0.008083574561406185, -0.23403391230085863, -0.49305545050297583],
        [0.4731321439445671, 0.05144165435247017, -0.13263352525629782],
        [-0.014508797944006686, -0.11023628281485548, -0.09899980765999435],
    ]
    np.testing.assert_allclose(table[100, :12], np.ravel(published), rtol=1e-12)
    assert pvs.load(tmp_path, "craft").inertia[1, 3] == pytest.approx(-0.6, abs=1e-12)  # type: ignore[arg-type]


@pytest.mark.skipif(mss.OCTAVE is None, reason="GNU Octave (octave-cli) is not installed")
def test_mss_function_moves_as_the_toolbox(tmp_path: object) -> None:
    """MSS 736a3d1, m2c, gvect and eulerang run in Octave: xdot of the same craft there."""
    (tmp_path / "craft.m").write_text(CRAFT_M)  # type: ignore[operator]
    nu, eta = [1, 0.2, -0.1, 0.05, 0.02, -0.3], [3, 4, 5, 0.2, -0.3, 0.4]
    tau = np.array([[9.0, 0, 0, 0, 0, 1]])
    xdot = mss.Session(tmp_path, "craft")(np.array([nu + eta]), tau)[0]  # type: ignore[arg-type]
    published = [
        [-0.5421468051826317, -0.2524345310550385, -0.005353227264033191],
        [-7.586185422525737, -0.129173834615298, -0.2384750000000001],
        [0.8117168432977341, 0.5775705188391709, 0.2398500824986571],
        [0.1397219233531323, 0.07920213079534319, -0.3036067291870566],
    ]
    np.testing.assert_allclose(xdot, np.ravel(published), rtol=1e-12)
    body = mss.load(tmp_path, "craft")  # type: ignore[arg-type]
    assert body.inertia[0, 4] == pytest.approx(0.6, abs=1e-12)
    rate = body.derivative(np.array([nu]), np.array([eta]), tau)[0]
    np.testing.assert_allclose(rate, xdot[:6], rtol=1e-10)


def test_holoocean_torpedo_accelerates_as_its_client() -> None:
    """HoloOcean 2.2.0 as DPRIcky/holoocean-multiagent-control ee6cdf1: Torpedo run there.

    dynamics(eta, nu) of the default dictionary with fins and propeller at rest.
    """
    body = holoocean.parse({"agents": [{"agent_name": "auv0", "dynamics": {}}]})
    diagonal = [31.868925221, 60.46822009, 60.46822009, 0.15803579, 7.4665391746, 7.4541271746]
    np.testing.assert_allclose(np.diag(body.inertia), diagonal, rtol=1e-9)
    nu = np.array([[1.2, -0.3, 0.2, 0.1, -0.2, 0.3]])
    eta = np.array([[0, 0, 5, 0.2, -0.3, 0.4]])
    published = [-0.347495641221, 0.136954504165, -0.253950133677]
    published += [-5.815737051668, 0.583959593367, -1.391779132058]
    np.testing.assert_allclose(body.derivative(nu, eta)[0], published, rtol=1e-11)


def test_ardupilot_submarine_has_the_constants_of_its_header() -> None:
    """ArduPilot SIM_Submarine.h: mass 16.75 kg by its comment; SIM_Submarine.cpp by hand.

    Four thrusters of 51.48 N ahead end at 2.065 m/s: 0.5 * 1023.6 * 0.06738 * 1.4 u^2.
    """
    body = sitl.parse("", "")
    area = np.pi / 4 * (np.pi * 0.008) ** (2 / 3)
    drag = -body.force(np.array([[1.0, 0, 0, 0, 0, 0]]), REST)[0, 0]
    assert drag == pytest.approx(0.5 * 1023.6 * area * 1.4)
    assert np.sqrt(4 * 51.48 / drag) == pytest.approx(2.065, abs=1e-3)
    assert body.inertia[3, 3] == pytest.approx(2 * 16.755 * 0.04 / 5, rel=1e-4)
    afloat = body.force(REST, REST)[0]
    assert afloat[2] == pytest.approx(-10.5 / 16.755, rel=1e-4)
    heel = body.force(REST, np.array([[0, 0, 0, 0.1, 0, 0]]))[0]
    assert heel[3] == pytest.approx(-40 * 0.15 * np.sin(0.1))
    changed = sitl.parse("`float weight = 11.0f;`", "SIM_BUOYANCY 0.0")
    assert changed.inertia[0, 0] == 11
    assert changed.force(REST, REST)[0, 2] == 0


def test_rigid_body_matches_an_offset_point() -> None:
    """Fossen (3.51): a mass point at r weighs m on its arm: m r^2 about the far axes."""
    mass = rigid_body(2.0, np.array([0.0, 0.0, 0.5]), np.zeros((3, 3)))
    np.testing.assert_allclose(np.diag(mass), [2, 2, 2, 0.5, 0.5, 0])
    assert mass[0, 4] == 1.0
    assert mass[1, 3] == -1.0


BOX = """<scenario><environment><ocean><water density="1025"/></ocean></environment>
  <materials><material name="hull" density="1000" restitution="0"/></materials>
  <robot name="r"><base_link name="b" type="box" physics="submerged">
    <dimensions xyz="1 0.5 0.4"/><origin xyz="0 0 0" rpy="0 0 0"/>
    <material name="hull"/><look name="l"/><mass value="205"/>
    <cg xyz="0 0 0.05" rpy="0 0 0"/>
    <hydrodynamics viscous_drag="0.1 0.1 0.1" quadratic_drag="0.8 1 1"/>
  </base_link></robot></scenario>"""


def test_stonefish_box_has_the_forces_of_its_source() -> None:
    """Stonefish b21eb8e1 SolidEntity.cpp:1763-1792 and :1263-1287, by hand for a box.

    Ahead at 2 m/s the front takes 0.5 rho Cd A u^3 (since v1.4 the flow's normal component
    multiplies flow |flow|), the four sides along the flow rho Cf A u.
    """
    body = stonefish.parse(BOX)
    force = body.force(np.array([[2.0, 0, 0, 0, 0, 0]]), REST)[0]
    pressure, skin = 0.5 * 1025 * 0.8 * 0.2 * 8, 1025 * 0.1 * 2 * (0.5 + 0.4) * 2
    assert force[0] == pytest.approx(-pressure - skin)
    # the box displaces 205 kg: it floats, and rights itself by W 0.05 sin(phi)
    heel = body.force(REST, np.array([[0, 0, 0, 0.1, 0, 0]]))[0]
    np.testing.assert_allclose(heel[:3], 0, atol=1e-9)
    assert heel[3] == pytest.approx(-205 * 9.81 * 0.05 * np.sin(0.1))
    # getAugmentedMass: the mean of the ellipsoid's added mass, alike on three axes
    x, y, z = stonefish.semi_axes(stonefish.box_mesh(np.array([1, 0.5, 0.4]))[0])
    mean = ((y + z) / 2) ** 2 * stonefish.lamb(x, (y + z) / 2)
    lumped = 4 / 3 * np.pi * 1025 * x * (mean + z * z + y * y) / 3
    np.testing.assert_allclose(np.diag(body.inertia)[:3], 205 + lumped)


def test_mujoco_moves_a_rigid_body_by_newton_and_euler() -> None:
    """MuJoCo runs; its free joint is read as doc/XMLreference.rst:2260 describes it."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed")
    text = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="hull"><freejoint/>
      <inertial pos="0.02 0.01 -0.03" mass="12" fullinertia="0.2 0.25 0.3 0.01 0.02 -0.015"/>
      </body></worldbody></mujoco>"""
    body = mujoco_body.Scene(text, lambda: None).body()
    tensor = np.array([[0.2, 0.01, 0.02], [0.01, 0.25, -0.015], [0.02, -0.015, 0.3]])
    centre = np.array([0.02, 0.01, -0.03])
    rigid = FLIP6 @ rigid_body(12.0, centre, tensor) @ FLIP6
    np.testing.assert_allclose(body.inertia, rigid, atol=1e-12)
    nu, eta = states(50)
    weight = push(FLIP @ centre, 12 * 9.81 * down(eta))
    np.testing.assert_allclose(body.force(nu, eta), weight - coriolis(rigid, nu), atol=1e-10)
