"""Swimming, section 4, in all its forms."""
