"""Pictures and films of a deformed body, drawn without a display.

    drawing    one body in one panel: camera, size, pixels
    page       panels with a title and a colour bar, and films of them
    pictures   what is asked for: a frame beside its truth, a path, segments, modes

Legend: N nodes of the body, M nodes of the obstacle, F facets, T frames. Lengths in [m] come in, pictures show [mm].
"""

from physics.view.drawing import ObstacleSurface
from physics.view.pictures import film, frame_picture, mode_film, mode_picture, mode_pictures, segment_picture

__all__ = ["ObstacleSurface", "film", "frame_picture", "mode_film", "mode_picture", "mode_pictures", "segment_picture"]
