"""New meshes of a deformed meridian: how they are made, and how a state is carried over to them."""
