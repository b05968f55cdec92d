"""Pictures and films of a deformed body, drawn without a display, and pages in which it is turned by hand.

    drawing    one body in one panel: camera, size, pixels
    page       panels with a title and a colour bar, and films of them
    pictures   what is asked for: a frame beside its truth, a path, segments, modes
    flow       a flow, by its vorticity
    lowrank    a motion kept as a few shapes
    exhibit    what a page shows of a body in motion
    viewer     the page, one file that opens offline
    web/       what the page is made of: HTML, style, and its program, which draws by WebGL

Legend: N nodes of the body, M nodes of the obstacle, F facets, T frames. Lengths in [m] come in, pictures show [mm].
"""

from physics.view.drawing import ObstacleSurface
from physics.view.exhibit import Animation, Exhibit, mode_exhibit, path_exhibit
from physics.view.flow import flow_film, flow_picture
from physics.view.pictures import film, frame_picture, mode_film, mode_picture, mode_pictures, segment_picture, still_picture
from physics.view.viewer import section, shell, write_page

__all__ = ["Animation", "Exhibit", "ObstacleSurface", "film", "flow_film", "flow_picture", "frame_picture", "mode_exhibit", "mode_film",
           "mode_picture", "mode_pictures", "path_exhibit", "section", "segment_picture", "shell", "still_picture", "write_page"]
