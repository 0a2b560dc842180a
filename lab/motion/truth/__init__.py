"""Truth: one twice-differentiable curve through a flight recording, or through frames as they come."""
