// Many bodies as one mesh: a call of WebGL for each body, in each pane and once more for its
// shadow, took most of a picture's time. A texture has a row for each body: where it is, and its
// colour.

const PLACED = `invariant gl_Position;
  attribute float body;
  uniform highp sampler2D bodies;
  vec4 texel(float k) { return texture2D(bodies, vec2(k / 4.0 + 0.125, body)); }
  vec3 placed(vec4 v) { return (v * mat4(texel(0.0), texel(1.0), texel(2.0), v)).xyz; }
  `;
const CHUNKS = {
  begin: "vec3 transformed = placed(vec4(position, 1.0));",
  beginnormal: "vec3 objectNormal = placed(vec4(normal, 0.0));",
  color: "#ifdef USE_COLOR\nvColor = texel(3.0).rgb;\n#endif",
};

export class Bodies {
  // The first `count` of these meshes, by each of these materials.
  constructor(parent, meshes, count, materials) {
    const T = MeshCat.THREE;
    this.numbers = new Float32Array(16 * meshes.length);
    this.texture = new T.DataTexture(this.numbers, 4, meshes.length, T.RGBAFormat, T.FloatType);
    const { attributes, index, ends } = joinedGeometry(meshes);
    const drawRange = { start: 0, count: ends[count] };
    const geometry = Object.assign(new T.BufferGeometry(), { attributes, index, drawRange });
    this.meshes = materials.map((material) => {
      const mesh = new T.Mesh(geometry, this.placing(material));
      mesh.frustumCulled = false;
      parent.add(mesh);
      return mesh;
    });
  }

  // Have a material draw each body where it is; one with colours of vertices, in its colour.
  placing(material) {
    material.onBeforeCompile = (shader) => {
      shader.uniforms.bodies = { value: this.texture };
      shader.vertexShader = PLACED + shader.vertexShader;
      for (const [name, code] of Object.entries(CHUNKS))
        shader.vertexShader = shader.vertexShader.replace(`#include <${name}_vertex>`, code);
    };
    return material;
  }

  // Draw each body where its place is, in the colour of what stands there; none without a place.
  draw(places) {
    const { numbers, texture } = this;
    const rows = new MeshCat.THREE.Matrix4();
    numbers.fill(0);
    places.forEach((place, k) => {
      if (!place) return;
      rows
        .copy(place.matrix)
        .transpose()
        .toArray(numbers, 16 * k);
      for (const { material } of place.children) material.color.toArray(numbers, 16 * k + 12);
    });
    for (const mesh of this.meshes) mesh.visible = places.some(Boolean);
    texture.needsUpdate = true;
  }
}

const joinedBefore = new Map(); // the same bodies stand in each pane

// The geometries of these meshes as one, as they lie below their places; `ends`: how many numbers
// of its index the first k of them take.
function joinedGeometry(meshes) {
  const T = MeshCat.THREE;
  const key = meshes.map(({ geometry, scale }) => [geometry.uuid, ...scale.toArray()]).join();
  if (joinedBefore.has(key)) return joinedBefore.get(key);
  const [position, normal, body, index, ends] = [[], [], [], [], [0]];
  const v = new T.Vector3();
  meshes.forEach(({ geometry, matrix }, k) => {
    const { attributes: from, index: corners } = geometry;
    const turn = new T.Matrix3().getNormalMatrix(matrix);
    const first = body.length;
    for (let i = 0; i < from.position.count; i++) {
      const at = 3 * body.push((k + 0.5) / meshes.length) - 3;
      v.fromBufferAttribute(from.position, i).applyMatrix4(matrix).toArray(position, at);
      v.fromBufferAttribute(from.normal, i).applyNormalMatrix(turn).toArray(normal, at);
    }
    // a mirrored triangle is seen from its other side
    const order = matrix.determinant() < 0 ? [0, 2, 1] : [0, 1, 2];
    for (let i = 0; i < corners.count; i += 3)
      for (const corner of order) index.push(first + corners.getX(i + corner));
    ends.push(index.length);
  });
  const joined = Object.assign(new T.BufferGeometry().setIndex(index), { ends });
  for (const [name, numbers] of Object.entries({ position, normal, body }))
    joined.setAttribute(name, new T.Float32BufferAttribute(numbers, name === "body" ? 1 : 3));
  joinedBefore.set(key, joined);
  return joined;
}
