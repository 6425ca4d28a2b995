"""Every equation of Mistry 2008 at random states, and its closed loops without dynamics."""
