"""What residuals say about an alignment: occlusion, light, bias, structure."""
