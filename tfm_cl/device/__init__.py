"""OpenCL: choosing a device, building kernels, launching them, and what they are told."""
