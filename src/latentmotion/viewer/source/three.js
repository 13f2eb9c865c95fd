// The parts of three.js in viewer.js that the studio's script uses, too, so that it need not hold them again.

export {
  AnimationClip, AnimationMixer, Bone, Box2, Box3, BoxGeometry, BufferAttribute, BufferGeometry, CanvasTexture, CatmullRomCurve3,
  CircleGeometry, ClampToEdgeWrapping, Color, ColorManagement, Controls, CylinderGeometry, DetachedBindMode,
  DirectionalLight, DoubleSide, FileLoader, Float32BufferAttribute, FrontSide, Group, HemisphereLight,
  ImageBitmapLoader, InstancedBufferAttribute, InstancedMesh, InterleavedBuffer, InterleavedBufferAttribute,
  Interpolant, InterpolateDiscrete, InterpolateLinear, Line, LineBasicMaterial, LineLoop, LineSegments,
  LinearFilter, LinearMipmapLinearFilter, LinearMipmapNearestFilter, LinearSRGBColorSpace, Loader,
  LoaderUtils, MOUSE, Material, MathUtils, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  MeshPhysicalMaterial, MeshStandardMaterial, MirroredRepeatWrapping, NearestFilter,
  NearestMipmapLinearFilter, NearestMipmapNearestFilter, NeutralToneMapping, NumberKeyframeTrack, Object3D,
  OrthographicCamera, PerspectiveCamera, Plane, PlaneGeometry, PointLight, Points, PointsMaterial,
  PropertyBinding, Quaternion, QuaternionKeyframeTrack, Ray, Raycaster, RepeatWrapping, RingGeometry,
  SRGBColorSpace, Scene, ShaderMaterial, ShadowMaterial, Skeleton, SkeletonHelper, SkinnedMesh, Sphere,
  SphereGeometry, Spherical, SpotLight, Sprite, SpriteMaterial, TOUCH, Texture, TextureLoader,
  TriangleFanDrawMode, TriangleStripDrawMode, TrianglesDrawMode, TubeGeometry, VSMShadowMap, Vector2, Vector3,
  VectorKeyframeTrack, WebGLRenderer,
} from "three";
