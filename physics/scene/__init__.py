"""What is simulated: a body, its materials, its supports and loads, rigid obstacles, and the steps.

    body    the body, its materials and places, with unit and bounds of every key
    parts   what happens to it: supports, loads, obstacles, steps, with unit and bounds of every key
    rules   which keys the shapes of bodies and obstacles need, take and refuse
    plane   what may not act across a plane body
    surface the closed surface of an obstacle, from a file of triangles
    tables  how loads, supports and obstacles go along the steps, in the scene or in a CSV file
    change  single values changed, as by --set
    flow    a fluid in a domain in place of a body that deforms
    scene   all of it together: read from TOML, checked, written back

A scene is a TOML file, read into frozen dataclasses. Coordinates are Cartesian [m]; the body is given in its stress-free rest
state. Step s = 0 .. count is a fraction s/count of the loading; it is a time only in dynamic scenes.
"""

from physics.scene.body import DRAWINGS, FOCUS, PLACES, PLANE_CELLS, Body, Material, Materials, Orthotropic, Where, is_drawing
from physics.scene.flow import FlowScene
from physics.scene.parts import Load, Obstacle, Steps, Support
from physics.scene.scene import Scene, beside, load_body, load_scene, load_solid, read_any, read_body, read_scene, scene_of

__all__ = [
    "DRAWINGS", "FOCUS", "PLACES", "PLANE_CELLS", "Body", "FlowScene", "Load", "Material", "Materials", "Obstacle", "Orthotropic",
    "Scene", "Steps", "Support", "Where", "beside", "is_drawing", "load_body", "load_scene", "load_solid", "read_any", "read_body",
    "read_scene", "scene_of"]
