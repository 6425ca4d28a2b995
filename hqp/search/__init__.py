"""Search for a configuration that meets the targets of a stack, on sessions that its caller makes."""
