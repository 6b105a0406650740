"""The texts that ``glvis init`` fills in: commented studies that run as they are."""

from __future__ import annotations

COVERAGE_TEXT = """\
[objective]
kind = "of1"                   # the share that at least one sensor sees
by_area = true                 # of the surface; false: of the number of faces
# kind = "of3"                 # counts overlap too: faces seen by two or three are worth most
# aggregate = "min"            # over several models: the worst one instead of the mean
"""
AREA_TEXT = """\
[objective]
kind = "of1"                   # the share that at least one sensor sees
by_area = true                 # of the surface; false: of the number of faces
# kind = "of3"                 # counts overlap too: what two or three see is worth most
# aggregate = "min"            # over several models: the worst one instead of the mean
"""
OVERLAP_TEXT = """\
[objective]
kind = "of3"                   # counts overlap too: faces seen by two or three are worth most
weights = "set1"               # Tables 1 and 2 of the paper; or w_tot, w_of1, w_of2 and overlap
by_area = false                # faces count one each, as in the paper; true: by their area
# kind = "of1"                 # the share that at least one sensor sees
"""
_SEARCH = """
[search]
method = "auto"                # or "swarm", with the options of a table [swarm]
max_maps = {max_maps}                # of one sensor on one model; more of them find more

[swarm]
seed = 1                       # the same seed gives the same run
"""
_MAPS_A_SENSOR = 1500  # and model: a minute or two for a first look


def search_table(sensors: int, models: int = 1) -> str:
    """Return the table [search], with a budget for so many sensors and models."""
    return _SEARCH.format(max_maps=_MAPS_A_SENSOR * sensors * models)


MESH_TEXT = """\
# Made by 'glvis init' from the size of the mesh. It runs as it is; change what is not so.
#
#   glvis check study.toml     says what is in it and how long a run takes
#
title = "{title}"
unit = "{unit}"                    # of the mesh, positions and ranges alike
up = {up}                 # what an image without roll shows upright

[scene]
models = [{models}]
{several}# {across} {unit} in all.
# max_edge = "off"             # large faces are cut into pieces ("auto"), or at a length of yours
# flip = true                  # turns the normals of a mesh that is inside out
# obstacles = ["table.stl"]    # hide what lies behind them, are never counted

{sensor}
# A number stands for itself; {{ min, max, start }} is free for the search, within its bounds.
{where}
{mounts}
{search}"""
WHERE_TEXTS = {
    "around": """\
# Sensors may stand anywhere about the part, outside of its box, and aim near its middle.
# Does it stand on a floor? glvis init --above. Is it a room? glvis init --room.""",
    "above": """\
# It stands on a floor, its lowest vertex: sensors may stand anywhere about it and above that,
# outside of its box, and aim near its middle. Is it held? glvis init --around. A room? --room.""",
    "room": """\
# A room, seen from within: sensors may hang anywhere in its upper part, off the walls,
# and aim at anything in it. Is it a thing to be seen from outside? glvis init --above.""",
}

RING_MOUNT_TEXT = """\
[[mount]]
name = "{name}"
sensor = "{sensor}"
aim = [{aim}]
[mount.ring]
axis = "{axis}"
radius = {radius}
angle_deg = {{ min = 0, max = 360, start = {angle}, periodic = true }}
height = {height}
centre = [{centre}]
"""

BOX_MOUNT_TEXT = """\
[[mount]]
name = "{name}"
sensor = "{sensor}"
position = [
  {position},
]
aim = [{aim}]
"""

ROOM_TEXT = """\
# Made by 'glvis init'. It runs as it is; change what is not so.
#
#   glvis check study.toml     says what is in it and how long a run takes
#
title = "{title}"
unit = "mm"
up = [0, 0, 1]

[scene]
models = ["{model}"]        # 3000 x 3000 x 2600 mm, a corner at the origin
# max_edge = "off"             # large faces are cut into pieces ("auto"), or at a length of yours
# obstacles = ["pillar.stl"]   # hide what lies behind them, are never counted

# The mounts below name "kinect-v2", which glvis knows: 70.6 x 60 deg, 500 to 4500 mm. Your own
# sensor goes into a table [sensor.NAME] with hfov_deg, vfov_deg, resolution, min_distance,
# max_distance and max_incidence_deg.

# A number stands for itself; {{ min, max, start }} is free for the search, within its bounds.
# Azimuth turns from +X towards +Y and wraps round; elevation is negative below level.
{mounts}
{search}"""

ROOM_MOUNT_TEXT = """\
[[mount]]
name = "{name}"
sensor = "kinect-v2"
position = [{{ min = 100, max = 2900, start = {sx} }}, {{ min = 100, max = 2900, start = {sy} }}, \
{{ min = 1500, max = 2500, start = {sz} }}]
direction = {{ azimuth_deg = {{ min = 0, max = 360, start = {azimuth}, periodic = true }}, \
elevation_deg = {{ min = -80, max = 10, start = -25 }} }}
"""

ARM_TEXT = """\
# Made by 'glvis init': a scanner for forearms, after Buonamici et al., Sec. 3.1. It runs as it is.
#
#   glvis check study.toml     says what is in it and how long a run takes
#
title = "Arm scanner, eight D415 on two rings"
unit = "mm"                    # of the mesh, positions and ranges alike
up = [0, 1, 0]                 # what an image without roll shows upright

[scene]
models = ["arm.stl"]           # along z; several arms are looked at one by one
# obstacles = ["holder.stl"]   # hide what lies behind them, are never counted

# The mounts below name "d415-buonamici", which glvis knows: 66.4 x 39.5 deg, 160 to 350 mm.

# A number stands for itself; {{ min, max, start }} is free for the search, within its bounds. A
# name of [variables] may stand wherever a number may, also in "180 - 2*alpha".
[variables]
z1 = {{ min = 60, max = 240, start = 136 }}      # height of the two rings
z2 = {{ min = -240, max = -60, start = -136 }}
alpha1 = {{ min = 5, max = 85, start = 45 }}     # places on them
beta1 = {{ min = 5, max = 85, start = 45 }}
alpha2 = {{ min = 5, max = 85, start = 45 }}
beta2 = {{ min = 5, max = 85, start = 45 }}

# A and B at x > 0; C and D are their mirror images at x < 0. They aim at a point of the arm.
{mounts}
{search}""".format(
    mounts="\n".join(
        f"""\
[[mount]]
name = "{name}{ring}"
sensor = "d415-buonamici"
ring = {{ axis = "z", radius = 300, angle_deg = "{angle}{ring}", height = "z{ring}" }}
aim = [0, 0, {{ min = {low}, max = {high}, start = {start} }}]
mirror = {{ plane = "yz", name = "{twin}{ring}" }}
"""
        for ring, low, high, start in ((1, 0, 180, 90), (2, -140, 40, -50))
        for name, twin, angle in (("A", "C", "-alpha"), ("B", "D", "beta"))
    ),
    search=OVERLAP_TEXT + search_table(8),
)
