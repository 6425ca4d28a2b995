"""Files with something wrong in them: drawn damage to recordings, URDF and MJCF files, and who must say what of it."""
