"""Elements: shape functions, deformation gradients, assembly."""
