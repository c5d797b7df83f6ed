"""Control problems: what is to be learned."""
