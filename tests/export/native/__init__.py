"""Sessions in C++ alone: recorded loops again, allocations counted, damaged files under sanitizers."""
