"""Contact: which feet stand and which parts touch, for a human, a robot and an object, in a clip and in a stream.

`rule` decides about points over a surface and a human's toes and heels, `soles` about a robot's feet, `touch` about hands, other
parts and bodies.
"""
