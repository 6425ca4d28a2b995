"""User declarations: elements with laws, in levels, in a stack."""
