"""The commented geometry file that `palpate scan template` writes."""

from palpate.errors import GeometryError

HEAD = """\
# Geometry file for `palpate scan import STACK --geometry THIS_FILE -o scan.h5`.
#
# World frame: right-handed, z from the panel towards the source, volume slices at constant z (parallel to the panel).
#
#            z        source
#            |       /
#            |    object            row index grows along row_axis, column index along column_axis;
#            |__/______ y           pixel (0, 0) is the first pixel of the stored image.
#           /  panel
#          x

units: mm                # of every length in this file: mm, cm, m or um. Angles are degrees.

values: photons          # photons: each number is a count. intensity: proportional to the dose (8-bit and so on).
                         # line integrals: natural logarithms log(incident / value), incident then as a number.
                         # Raw read-outs of a panel: palpate scan correct, which uses neither `values` nor `incident`.
incident: 20000          # what a pixel reads with nothing in the beam: one number, a list (one a view), or estimate
                         # (from the brightest level that many pixels of a view share; some air must be in each view).
background: 0            # what a pixel reads behind a perfect absorber: scatter and dark signal. One number or a list.
# contrast: as stored    # equal (intensities only): undo a display scale that gave each view its own.
# unmeasured: 0          # a value that marks pixels that measured nothing (outside the field); they are masked.
# scatter: none          # estimate: from the table, for the beam below; or a file (.npy) of photons a pixel, as the views
# beam: {kv: 30, target: W/Rh, gap: 15, grid: none}   # for estimate: anode/filter, object to panel, anti-scatter grid
# blur: {panel: 0.2, focal_spot: 0.3}   # full widths at half maximum; at: height of the plane whose magnification counts
# dead: dead.txt         # a text file beside this one, one "row column" a line: pixels to mask in every view.

stack:
  axes: [view, row, column]   # order of the axes as stored, slowest first; for MATLAB files in the order of size().
  # variable: projections     # the array's name in a MATLAB file that holds several
  # format: raw               # raw, tiff, mat or npy; needed only where the file's name does not tell
  # dtype: uint16             # for raw files: type, shape in the order of `axes`, bytes to skip, byte order
  # shape: [{count}, 512, 512]
  # offset: 0
  # order: little

"""

LEVEL = """\
panel:
  shape: [512, 512]           # rows, columns
  pitch: [0.4, 0.4]           # between rows, between columns
  centre: [0, 0, 0]           # of the panel; or origin: centre of pixel (0, 0)
  row_axis: [0, 1, 0]         # direction in which the row index grows
  column_axis: [1, 0, 0]      # direction in which the column index grows

"""

BARE = """\
panel:                        # the motion below places it
  shape: [512, 512]           # rows, columns
  pitch: [0.8, 0.8]           # between rows, between columns

"""

PIVOTED = """\
panel:                        # at angle 0
  shape: [512, 512]           # rows, columns
  pitch: [0.8, 0.8]           # between rows, between columns
  centre: [0, 0, -500]        # of the panel; or origin: centre of pixel (0, 0)
  row_axis: [0, -1, 0]        # direction in which the row index grows
  column_axis: [1, 0, 0]      # direction in which the column index grows

"""

VIEWS = {
    "circular": """\
views:
  motion: circular            # the tube circles above a level panel
  count: 8
  radius: 250
  height: 1000                # of the circle above the panel
  start: 0                    # angle of the first view, from +x towards +y
  # centre: [0, 0]            # (x, y) of the circle; the panel's centre if left out
  # fulcrum: 60               # height above the panel of the plane that stays still as the panel moves against the tube
""",
    "linear": """\
views:
  motion: linear              # the tube moves along a straight line above a level panel
  count: 15
  length: 500
  height: 1000                # above the panel
  direction: 0                # of the line, from +x towards +y
  # centre: [0, 0]            # (x, y) of the middle; the panel's centre if left out
  # fulcrum: 60               # height above the panel of the plane that stays still as the panel moves against the tube
""",
    "hypocycloid": """\
views:
  motion: hypocycloid         # a point of a circle that rolls inside a circle, above a level panel
  count: 24
  radius: 250                 # of the outer circle
  height: 1000                # above the panel
  cusps: 3
""",
    "arc": """\
views:
  motion: arc                 # the tube swings in a plane of constant y; the panel stays still (breast tomosynthesis)
  angles: {first: -25, last: 25, count: 15}   # from +z, positive towards +x; or a list [-25, -21, ...]
  radius: 650                 # from pivot to focal spot
  pivot: [0, 0, 40]
""",
    "rotating": """\
views:
  motion: rotating            # tube and panel turn together (a C-arm); the panel above is its pose at angle 0
  angles: [-20, -16, -12, -8, -4, 0, 4, 8, 12, 16, 20]   # right-handed about the axis: about +y from +z towards +x
  source: [0, 0, 1000]        # at angle 0
  pivot: [0, 0, 0]            # a point on the axis
  axis: [0, 1, 0]
""",
    "orbit": """\
views:
  motion: orbit               # tube and panel turn around the object (CT, a C-arm, laminography)
  source_to_centre: 600       # from the focal spot to the axis
  source_to_panel: 1000
  count: 200
  arc: 360                    # of the whole turn; less than 360 has both its ends
  start: 0                    # angle of the first view
  elevation: 0                # of the central rays out of the plane across the axis; about 60 for laminography
  axis: [0, 0, 1]             # rows of the panel grow along it; about +z the tube moves from +x towards +y
  centre: [0, 0, 0]           # the point that all central rays meet
""",
    "parallel": """\
views:
  motion: parallel            # a parallel beam, the panel opposite it; otherwise as orbit
  centre_to_panel: 400        # the panel must lie behind the object in every view
  count: 180
  arc: 180
  start: 0
  elevation: 0
  axis: [0, 0, 1]
  centre: [0, 0, 0]
""",
    "free": """\
views:                        # one entry a view, in the order of the stack
  - source: [-200, 0, 1000]
  - source: [0, 0, 1000]      # or direction: [0, 0, -1], of a parallel beam's rays
  - source: [200, 0, 1000]
    panel:                    # only where the panel moves: its pose in this view (shape and pitch stay)
      centre: [-12, 0, 0]
      row_axis: [0, 1, 0]
      column_axis: [1, 0, 0]
""",
}
PANELS = {"rotating": PIVOTED, "orbit": BARE, "parallel": BARE}
COUNT = {
    "circular": 8,
    "linear": 15,
    "hypocycloid": 24,
    "arc": 15,
    "rotating": 11,
    "orbit": 200,
    "parallel": 180,
    "free": 3,
}


def template(motion: str = "arc") -> str:
    """A commented geometry file for a motion, one of `VIEWS`. Raises `GeometryError`."""
    if motion not in VIEWS:
        raise GeometryError(f"motion: expected one of {', '.join(VIEWS)}, got {motion!r}")
    return HEAD.replace("{count}", str(COUNT[motion])) + PANELS.get(motion, LEVEL) + VIEWS[motion]
