"""BVH texts that tests write by hand."""

HEAD = """HIERARCHY
ROOT Hips
{
\tOFFSET 0 0 0
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT Spine
\t{
\t\tOFFSET 0 10 0
\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0 5 0
\t\t}
\t}
}
"""
"""A root with six channels in lines 1 … 15, a joint with three, an end."""

ROWS = ("1 2 3 90 0 0 0 0 0", "4 5 6 0 90 0 0 0 90")


def text(head: str = HEAD, rows: tuple[str, ...] = ROWS, frames: int | str | None = None, time: str = "0.04") -> str:
    """A whole file; `frames` is what it says of its rows."""
    said = len(rows) if frames is None else frames
    return f"{head}MOTION\nFrames: {said}\nFrame Time: {time}\n" + "\n".join(rows) + "\n"
