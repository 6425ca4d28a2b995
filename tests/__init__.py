"""The tests of hqp."""
