// Renders the models that the server names, one after the other, and sends the images back.
//
// A job: `model` (its address), `width`, `height`, `factor` (odd: pixels rendered per pixel along
// each axis, of which the middle one is kept), `moved`, `camera`, and `shapes`: for "mesh/primitive" the set
// of texture coordinates (or null), and whether normals are interpolated before the node transforms
// them. The result is float32 RGBA, bottom row first: colour and coverage; normal and distance from
// the camera; texture coordinates, and the contrast of colours: the largest difference to the colour
// of a point that is `moved` pixels away along x or y.

import * as THREE from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";

THREE.ColorManagement.enabled = true;
const renderer = new THREE.WebGLRenderer({ antialias: false, alpha: true });
renderer.toneMapping = THREE.NoToneMapping;
renderer.sortObjects = false;
renderer.setClearColor(0, 0);
if (!renderer.extensions.get("EXT_color_buffer_float")) throw new Error("no EXT_color_buffer_float");

const VERTEX = `
  #include <common>
  #include <morphtarget_pars_vertex>
  #include <skinning_pars_vertex>
  uniform bool grouped;
  attribute vec2 coordinates;
  varying vec3 atNormal;
  varying vec3 atWorld;
  varying vec2 atCoordinates;
  flat varying mat3 toNormal;
  // The inverse transpose, times a positive number.
  mat3 cofactors(mat3 m) {
    return mat3(cross(m[1], m[2]), cross(m[2], m[0]), cross(m[0], m[1])) * sign(determinant(m));
  }
  void main() {
    #include <beginnormal_vertex>
    #include <morphinstance_vertex>
    #include <morphnormal_vertex>
    #include <skinbase_vertex>
    #ifdef USE_SKINNING
      // three.js itself takes the matrix of positions for normals.
      mat4 bones = skinWeight.x * boneMatX + skinWeight.y * boneMatY + skinWeight.z * boneMatZ
        + skinWeight.w * boneMatW;
      objectNormal = cofactors(mat3(bindMatrixInverse * bones * bindMatrix)) * objectNormal;
    #endif
    #include <begin_vertex>
    #include <morphtarget_vertex>
    #include <skinning_vertex>
    mat4 world = modelMatrix;
    #ifdef USE_INSTANCING
      world = world * instanceMatrix;
    #endif
    mat3 ofNormals = cofactors(mat3(world));
    toNormal = grouped ? ofNormals : mat3(1.0);
    atNormal = normalize(grouped ? objectNormal : ofNormals * objectNormal);
    vec4 place = world * vec4(transformed, 1.0);
    atWorld = place.xyz;
    atCoordinates = coordinates;
    gl_Position = projectionMatrix * viewMatrix * place;
  }`;
const NORMAL = `
  uniform vec3 eye, backwards;
  uniform bool parallel;
  varying vec3 atNormal;
  varying vec3 atWorld;
  flat varying mat3 toNormal;
  void main() {
    vec3 offset = atWorld - eye;
    float distance = parallel ? -dot(offset, backwards) : length(offset);
    gl_FragColor = vec4(normalize(toNormal * normalize(atNormal)), distance);
  }`;
const COORDINATES = `
  varying vec2 atCoordinates;
  void main() { gl_FragColor = vec4(atCoordinates, 0.0, 1.0); }`;

const vector = (numbers) => new THREE.Vector3(...numbers);

// The camera, moved by x pixels to the right and y pixels up.
function cameraOf({ camera: given, width, height }, x, y) {
  const { origin, u, v, w, window: [left, right, bottom, top], orthographic, near, far, shift } = given;
  const camera = new THREE.Camera();
  const across = ((shift + x) * (right - left)) / width;
  const along = (y * (top - bottom)) / height;
  const sides = [left + across, right + across, top + along, bottom + along];
  if (orthographic) camera.projectionMatrix.makeOrthographic(...sides, near, far);
  else camera.projectionMatrix.makePerspective(...sides.map((side) => side * near), near, far);
  camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert();
  camera.matrixAutoUpdate = false;
  camera.matrix.makeBasis(vector(u), vector(v), vector(w)).setPosition(vector(origin));
  camera.updateMatrixWorld(true);
  return camera;
}

// Notes the index of the mesh and of the primitive in each object; clones keep the note.
function places(parser) {
  const load = parser.loadMesh.bind(parser);
  parser.loadMesh = async (index) => {
    const object = await load(index);
    const parts = object.isGroup ? object.children : [object];
    parts.forEach((part, primitive) => (part.userData.place = `${index}/${primitive}`));
    return object;
  };
  return { name: "places" };
}

// A geometry with normals of its triangles where the file has none, and the texture coordinates of
// one set as `coordinates`.
function prepared(geometry, set) {
  let result = geometry.clone();
  if (!result.attributes.normal) {
    if (result.index) result = result.toNonIndexed();
    result.computeVertexNormals();
  }
  const source = set === null ? undefined : result.attributes[set === 0 ? "uv" : `uv${set}`];
  // Ours are (0, 0) without coordinates, with v up.
  const count = result.attributes.position.count;
  const none = () => new THREE.BufferAttribute(Float32Array.from({ length: 2 * count }, (_, i) => i % 2), 2);
  result.setAttribute("coordinates", source ?? none());
  return result;
}

async function render(job) {
  const gltf = await new GLTFLoader().register(places).loadAsync(job.model);
  const { width, height, factor } = job;
  let camera = cameraOf(job, 0, 0);
  const scene = new THREE.Scene();
  scene.add(gltf.scene);
  scene.updateMatrixWorld(true);
  const meshes = [], others = [];
  gltf.scene.traverse((object) => {
    object.frustumCulled = false;
    if (object.isMesh) meshes.push(object);
    else if (object.isLine || object.isPoints) others.push(object);
  });
  for (const object of others) object.visible = false;
  for (const { material } of meshes) {
    if (!material.isMeshBasicMaterial) throw new Error(`not unlit: ${material.type}`);
    material.toneMapped = false;
    material.side = THREE.DoubleSide;
    const { map } = material;
    if (!map) continue;
    map.minFilter = map.magFilter === THREE.NearestFilter ? THREE.NearestFilter : THREE.LinearFilter;
    map.generateMipmaps = false;
    map.anisotropy = 1;
    map.needsUpdate = true;
  }
  const [wide, high] = [width * factor, height * factor];
  const depthTexture = new THREE.DepthTexture(wide, high, THREE.FloatType);
  const target = new THREE.WebGLRenderTarget(wide, high, {
    type: THREE.FloatType,
    format: THREE.RGBAFormat,
    minFilter: THREE.NearestFilter,
    magFilter: THREE.NearestFilter,
    generateMipmaps: false,
    samples: 0,
    depthTexture,
  });
  const all = new Float32Array(wide * high * 4);
  const result = new Float32Array(3 * width * height * 4);
  const pass = (number) => {
    renderer.setRenderTarget(target);
    renderer.clear();
    renderer.render(scene, camera);
    renderer.readRenderTargetPixels(target, 0, 0, wide, high, all);
    const middle = (factor - 1) / 2;
    for (let y = 0; y < height; y++)
      for (let x = 0; x < width; x++) {
        const from = 4 * ((y * factor + middle) * wide + x * factor + middle);
        result.set(all.subarray(from, from + 4), 4 * ((number * height + y) * width + x));
      }
  };
  const plane = 4 * width * height;
  const contrasts = new Float32Array(width * height);
  if (meshes.some(({ material }) => material.map)) {
    for (const [x, y] of [[-1, 0], [1, 0], [0, -1], [0, 1]]) {
      camera = cameraOf(job, x * job.moved, y * job.moved);
      // The colour and its neighbour, in the first two images of the result.
      pass(1);
      if (x === -1) {
        camera = cameraOf(job, 0, 0);
        pass(0);
      }
      contrasts.forEach((value, at) => {
        const difference = (channel) => Math.abs(result[4 * at + channel] - result[plane + 4 * at + channel]);
        contrasts[at] = Math.max(value, difference(0), difference(1), difference(2));
      });
    }
    camera = cameraOf(job, 0, 0);
  } else pass(0);
  for (const object of meshes) {
    const shape = job.shapes[object.userData.place];
    if (!shape) throw new Error(`a mesh that we do not have: ${object.userData.place}`);
    object.geometry = prepared(object.geometry, shape.set);
    object.userData.grouped = shape.grouped;
  }
  [NORMAL, COORDINATES].forEach((fragmentShader, number) => {
    for (const object of meshes) {
      object.material = new THREE.ShaderMaterial({
        vertexShader: VERTEX,
        fragmentShader,
        side: THREE.DoubleSide,
        uniforms: {
          grouped: { value: object.userData.grouped },
          eye: { value: vector(job.camera.origin) },
          backwards: { value: vector(job.camera.w) },
          parallel: { value: job.camera.orthographic },
        },
      });
    }
    pass(1 + number);
  });
  contrasts.forEach((value, at) => (result[2 * plane + 4 * at + 2] = value));
  renderer.setRenderTarget(null);
  target.dispose();
  depthTexture.dispose();
  for (const object of meshes) {
    object.geometry.dispose();
    object.material.dispose();
  }
  return result;
}

// A model with its own materials, and with the given lights if it has none: linear RGBA, bottom row
// first.
async function lit(job) {
  const gltf = await new GLTFLoader().loadAsync(job.model);
  const { width, height } = job;
  const { direction, irradiance, ambient, background } = job.lights;
  const scene = new THREE.Scene();
  scene.add(gltf.scene);
  scene.updateMatrixWorld(true);
  let hasLights = false;
  gltf.scene.traverse((object) => {
    object.frustumCulled = false;
    hasLights ||= object.isLight;
  });
  if (!hasLights && direction) {
    const sun = new THREE.DirectionalLight(0xffffff, irradiance);
    sun.position.copy(vector(direction)).negate();
    // A white matte surface reflects an irradiance of pi times the radiance of ambient light.
    scene.add(sun, new THREE.AmbientLight(0xffffff, Math.PI * (ambient ?? 0)));
  }
  // The limits of depth follow from the bounds.
  const bounds = new THREE.Box3().setFromObject(scene).getBoundingSphere(new THREE.Sphere());
  const distance = bounds.center.distanceTo(vector(job.camera.origin));
  const far = distance + 1.01 * bounds.radius;
  const near = Math.max(distance - 1.01 * bounds.radius, far * 1e-4);
  const camera = cameraOf({ ...job, camera: { ...job.camera, near, far } }, 0, 0);
  const target = new THREE.WebGLRenderTarget(width, height, {
    type: THREE.FloatType,
    format: THREE.RGBAFormat,
    samples: 4,
  });
  renderer.setClearColor(new THREE.Color(background, background, background), 1);
  renderer.setRenderTarget(target);
  renderer.clear();
  renderer.render(scene, camera);
  const result = new Float32Array(4 * width * height);
  renderer.readRenderTargetPixels(target, 0, 0, width, height, result);
  renderer.setRenderTarget(null);
  renderer.setClearColor(0, 0);
  target.dispose();
  return result;
}

async function main() {
  for (;;) {
    const job = await (await fetch("/job")).json();
    if (job === null) continue;
    let body, failed = false;
    try {
      body = (await (job.lit ? lit(job) : render(job))).buffer;
    } catch (error) {
      [body, failed] = [String(error?.stack ?? error), true];
    }
    await fetch(failed ? "/failed" : "/done", { method: "POST", body });
  }
}

main().catch((error) => fetch("/failed", { method: "POST", body: String(error?.stack ?? error) }));
window.addEventListener("error", (event) => fetch("/failed", { method: "POST", body: event.message }));
