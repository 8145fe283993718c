"""What performers speak: one file a protocol, each a decoder of bytes into frames."""
