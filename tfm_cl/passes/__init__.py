"""The passes: one class each, owning its kernels and the buffers it fills."""
