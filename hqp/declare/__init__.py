"""What a user declares: elements with laws, in levels, in a stack."""
