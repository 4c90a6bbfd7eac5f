// What src/report/assets/viewer.js uses of three.js.
export {
  BufferAttribute, BufferGeometry, Color, DoubleSide, Float32BufferAttribute, Group, Line,
  LineBasicMaterial, LineSegments, GLSL3, Mesh, MeshBasicMaterial, NoBlending, PerspectiveCamera,
  Points, Raycaster, Scene, ShaderMaterial, Vector2, Vector3, WebGLRenderTarget, WebGLRenderer
} from 'three';
export {OrbitControls} from 'three/examples/jsm/controls/OrbitControls.js';
