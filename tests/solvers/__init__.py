"""The conformance suite that every solver passes."""
