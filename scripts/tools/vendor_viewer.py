"""Bundle the viewer's two libraries, three.js and uPlot, into one module: `python scripts/tools/vendor_viewer.py` (needs npm).

Only what the viewer uses is in it. Its result is kept with the package, so that a page can be written without npm; the
licences go with it, into every page.
"""

import json
import subprocess
import tempfile
from pathlib import Path

VERSIONS = {"three": "0.187.0", "uplot": "1.6.32", "esbuild": "0.28.2"}
THREE = """
  BoxGeometry BufferAttribute BufferGeometry CanvasTexture CapsuleGeometry CircleGeometry Color CylinderGeometry
  DirectionalLight DoubleSide DynamicDrawUsage Fog Group HemisphereLight InstancedMesh LineBasicMaterial LineLoop
  LinearMipmapNearestFilter Matrix4 Mesh MeshBasicMaterial MeshLambertMaterial NeutralToneMapping PCFShadowMap PerspectiveCamera Plane PlaneGeometry
  Quaternion Raycaster RepeatWrapping SRGBColorSpace Scene ShadowMaterial SphereGeometry Vector2 Vector3 WebGLRenderer
"""
ENTRY = f"""
export {{ {", ".join(THREE.split())} }} from "three";
export {{ OrbitControls }} from "three/examples/jsm/controls/OrbitControls.js";
export {{ mergeGeometries, mergeVertices, toCreasedNormals }} from "three/examples/jsm/utils/BufferGeometryUtils.js";
export {{ default as uPlot }} from "uplot";
"""
ASSETS = Path(__file__).resolve().parents[2] / "robot_retarget/tools/view/web/assets"


def main() -> None:
    """Fetch by npm, bundle by esbuild, put beside the viewer's own scripts."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "package.json").write_text(json.dumps({"private": True, "dependencies": VERSIONS}))
        (folder / "entry.js").write_text(ENTRY)
        subprocess.run(["npm", "install", "--silent"], cwd=folder, check=True)
        bundle = ["--bundle", "--minify", "--format=esm", "--target=es2022", "--legal-comments=none"]
        made = f"--outfile={ASSETS / 'vendor.js'}"
        subprocess.run(["npx", "esbuild", "entry.js", *bundle, made], cwd=folder, check=True)
        modules = folder / "node_modules"
        (ASSETS / "vendor.css").write_text((modules / "uplot/dist/uPlot.min.css").read_text())
        (ASSETS / "vendor.LICENCES.txt").write_text(_licences(modules))


def _licences(modules: Path) -> str:
    parts = [f"three.js {VERSIONS['three']} and uPlot {VERSIONS['uplot']} are part of this page.\n"]
    parts += [
        f"{name}\n\n{(modules / folder / 'LICENSE').read_text()}"
        for name, folder in (("three.js", "three"), ("uPlot", "uplot"))
    ]
    return "\n".join(parts)


if __name__ == "__main__":
    main()
