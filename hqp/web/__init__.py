"""Pages on a port: access control."""
