"""Given steps, uniform or along a mesh: schemes, histories, and the march that joins them."""
