"""Words of column names: quantities, axes, sources, what is no measurement."""

from __future__ import annotations

from collections.abc import Mapping

QUANTITIES: Mapping[str, str] = {
    "rate": (
        "gyro gyr gyroscope gyroscopes omega rate rates angvel avel rotrate drehrate"
        " winkelgeschwindigkeit"
    ),
    "dot": "dot",
    "angular": "angular",
    "ang": "ang",
    "linear": "linear lin",
    "twist": "twist",
    "acceleration": (
        "accel accels acc accelerometer accelerometers acceleration accelerations linacc"
        " beschleunigung sf"
    ),
    "velocity": "velocity velocities vel vels speed spd geschwindigkeit vitesse",
    "angle": "angle angles euler rpy ypr winkel",
    "attitude": "attitude att",
    "rotation": "rotation rot",
    "position": "position pos translation trans location loc",
    "quaternion": "quaternion quat orientation ori",
    "depth": "depth tiefe profondeur",
    "pressure": "pressure press druck pression",
    "output": (
        "pwm pulse pulses servo motor thruster thrusters output outputs thr rcou esc mot thrust ch"
        " chan channel channels actuator actuators rcout"
    ),
    "command": "cmd command tau ctrl control input joy demand effort",
    "thrust": "thrust",
    "propeller": "propeller prop propulsor screw shaft engine",
    "turns": "rpm revs drehzahl",
    "fin": "fin fins",
    "rudder": "rudder rudders",
    "elevator": "elevator elevators plane planes sternplane sternplanes",
    "tow": "tow towing towed carriage",
    "force": "force load",
    "drag": "drag",
    "tension": "tension zugkraft",
    "voltage": "voltage volt volts vbat vbatt vbus millivolt spannung",
    "current": "current curr",
    "battery": "battery batt bat batterie pack",
    "latitude": "lat latitude",
    "longitude": "lon lng long longitude",
    "fix": "usbl ugps gps acoustic lbl fix",
    "northing": "northing",
    "easting": "easting",
    "time": (
        "t ts time timestamp timestamps stamp times datetime utc elapsed secs seconds sec epoch"
        " zeit zeitstempel temps clock"
    ),
}
"""Quantity -> the words for it; a word may stand for several."""
AXES: Mapping[str, tuple[str, int]] = {
    **{name: ("xyz", n) for n, name in enumerate("xyz")},
    **{name: ("uvw", n) for n, name in enumerate("uvw")},
    **{name: ("pqr", n) for n, name in enumerate("pqr")},
    **{name: ("kmn", n) for n, name in enumerate("kmn")},
    **{name: ("way", n) for n, name in enumerate(("surge", "sway", "heave"))},
    **{name: ("turn", n) for n, name in enumerate(("roll", "pitch", "yaw"))},
    **{name: ("turn", n) for n, name in enumerate(("phi", "theta", "psi"))},
    **{name: ("turn", n) for n, name in enumerate(("roulis", "tangage", "lacet"))},
    **{name: ("turn", n) for n, name in enumerate(("roll", "nick", "gier"))},
    **dict.fromkeys(("heading", "hdg", "compass", "kurs", "cap"), ("heading", 2)),
    **dict.fromkeys(("forward", "fwd", "ahead", "longitudinal"), ("side", 0)),
    **dict.fromkeys(("starboard", "stbd", "right", "left", "port", "lateral"), ("side", 1)),
    **dict.fromkeys(("down", "up"), ("side", 2)),
}
"""Word of an axis -> its kind and its number."""
FLIPPED = ("left", "port", "up")
FIN_LETTERS: Mapping[str, str] = {
    **dict.fromkeys(("s", "starboard", "stbd", "right"), "s"),
    **dict.fromkeys(("p", "port", "left"), "p"),
    **dict.fromkeys(("b", "bottom", "lower", "low"), "b"),
    **dict.fromkeys(("t", "top", "upper", "up"), "t"),
}
LETTERS: Mapping[str, str] = {
    "v": "velocity",
    "a": "acceleration",
    "w": "rate",
    "g": "rate",
    "p": "position",
    "q": "quaternion",
    "u": "command",
}
"""Letters that are a quantity before x, y or z."""
SHORT_OUTPUTS = ("c", "t", "m")
"""Letters that are outputs before a number."""
ALIASES: Mapping[str, str] = {
    "tiefe": "depth",
    "profondeur": "depth",
    "druck": "pressure",
    "pression": "pressure",
    "zeit": "time",
    "zeitstempel": "timestamp",
    "temps": "time",
    "roulis": "roll",
    "tangage": "pitch",
    "nick": "pitch",
    "lacet": "yaw",
    "gier": "yaw",
    "ist": "actual",
}
"""Words of other languages that other modules look for in English."""
_SOURCES = """
data msg msgs message field value val values header vector vec xyz component axis in of from by out
rc raw filtered filt lpf smooth smoothed unwrapped measured meas
scaled calibrated cal corrected compensated uncomp measurement actual act fb feedback deflection
est estimated estimate estimates estimator ekf ukf kf true truth gt ground model simulation sim
sensor sensors sens combined imu imus ins ahrs mru fog ctd dvl bt xsens vectornav microstrain keller
nortek nucleus waterlinked teledyne sparton sbg phins kvh valeport paroscientific pixhawk
odom odometry state states pose nu eta mocap qualisys qtm optitrack vicon marker rigid body origin
frame b frd flu ned enu nwu yup local world global inertial earth map nav navigation
log logged record recording bag ros rosbag mavros mavlink
vehicle auv rov uuv asv robot bluerov brov remus device system sys host server recv receive
received unix posix boot since start
abs absolute relative rel external ext water sea hydrostatic fluid primary main supply bus line
"""
SOURCES = frozenset(_SOURCES.split())
"""Words that say where a column comes from, not what it is."""
_BARE_PLACE = """
pose odom odometry state model eta est estimated estimate ekf gt truth ground true filtered
measured meas mocap qualisys qtm optitrack vicon marker rigid ned enu nwu yup local world map origin
vehicle auv rov robot bluerov brov
"""
BARE_PLACE = frozenset(_BARE_PLACE.split())
"""Sources behind which x, y and z without another word are a position."""
_NO_MEASUREMENT = """
desired des target tgt setpoint setpoints sp ref reference goal wanted demanded commanded consigne
soll waypoint wp mission plan limit gain gains kp ki kd pid controller
std stddev sd sigma variance var covariance cov fom accuracy uncertainty err error errors residual
residuals innov innovation bias offset noise drift rms min max mean median
valid validity status flag flags count seq sequence id index quality clipping clip samples
integral integ derivative jerk delta diff old prev previous
temperature temp temperatur magnetometer mag magnetic magn declination humidity salinity sound
north east gravity grav sog cog course track cross climb
wave waves swell wind ocean tide seabed seafloor floor bottom air atmospheric atm cabin baro
barometer barometric internal int housing hull
camera cam gimbal pan tilt ship vessel boat usv buoy arm joint finger gripper manipulator tether
umbilical winch leak cpu light lights obstacle beacon home rcin throttle joystick stick fan pump
wrench transducer transducers beam beams rssi nsd
"""
NO_MEASUREMENT = frozenset(_NO_MEASUREMENT.split())
"""What is commanded, says how sure something is, or belongs to another thing."""
_WORLD = "local ned enu nwu yup world global inertial earth map"
WORLD = frozenset(_WORLD.split())
"""Frames in which a velocity is none of the axes of the body, and a position is one."""
UPWARD: Mapping[str, str] = {"enu": "enu", "nwu": "flu", "yup": "y_up"}
"""World with z or y up -> frame of a column map."""
PHRASES: Mapping[tuple[str, ...], tuple[str, ...]] = {
    ("set", "point"): ("setpoint",),
    ("y", "up"): ("yup",),
    ("vehicle", "odometry"): ("ned",),
    ("position", "estimate"): ("state",),
    ("local", "position", "pose"): ("pose",),
    ("local", "position", "odom"): ("odom",),
    ("local", "position", "velocity"): ("velocity",),
    ("pose", "estimate"): ("state",),
    ("magnetic", "heading"): ("heading",),
    ("mag", "heading"): ("heading",),
    ("compass", "heading"): ("heading",),
    ("true", "heading"): ("heading",),
    ("bottom", "track"): ("dvl",),
    ("body", "rate"): ("rate",),
    ("body", "rates"): ("rate",),
    ("specific", "force"): ("acceleration",),
    ("load", "cell"): ("tow", "force"),
    ("stern", "plane"): ("elevator",),
    ("stern", "planes"): ("elevator",),
    ("delta", "r"): ("rudder",),
    ("delta", "s"): ("elevator",),
    ("delta", "e"): ("elevator",),
    ("cmd", "vel"): ("setpoint",),
    ("command", "vel"): ("setpoint",),
    ("rc", "in"): ("rcin",),
    ("rc", "channels"): ("rcin",),
    ("turn", "rate"): ("rate",),
    ("below", "surface"): (),
    ("gauge", "pressure"): ("pressure",),
    ("raw", "count"): ("count",),
    ("time", "of", "flight"): ("delta",),
    ("water", "depth"): ("seabed",),
    ("water", "temp"): ("temp",),
    ("water", "current"): ("ocean",),
    ("bar", "30"): ("sensor",),
    ("bar", "02"): ("sensor",),
    ("ms", "5837"): ("sensor",),
    ("a", "50"): ("dvl",),
    ("vn", "100"): ("imu",),
    ("center", "of", "mass"): ("body",),
    ("rigid", "body"): ("rigid",),
}
"""Words that mean something only together."""
