"""Data sets: families of scenes, trajectory files, and folders of them."""
