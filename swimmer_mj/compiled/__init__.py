"""What compiled code is made of: SIMD vectors, elementary functions, stack buffers, the cache on disk."""
