"""What scenes are drawn?

    family   a scene file with ranges, and its reproducible draws
    place    where an obstacle goes: at which place along the body, from how far, how deep
    vary     one body under many obstacles
"""
