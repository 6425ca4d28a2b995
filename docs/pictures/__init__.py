"""The pictures of the docs, made headless by MuJoCo: ``python -m docs.pictures``; EGL or OSMesa is needed."""
