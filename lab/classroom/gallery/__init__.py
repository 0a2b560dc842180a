"""Break-it gallery: one fault in the navigator or in its data, which a student finds from its signature."""
