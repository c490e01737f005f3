"""Stress and tangent of any law at all quadrature points, and zones of another stiffness."""
