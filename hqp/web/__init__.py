"""Pages on a port: who may open them."""
