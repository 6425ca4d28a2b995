"""Sessions in C++ alone: recorded loops, allocation counts, damaged files under sanitizers."""
