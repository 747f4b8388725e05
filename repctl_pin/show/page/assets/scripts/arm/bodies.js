// Many bodies as one mesh: a call of WebGL for each body, in each pane and for its shadow, took most
// of a picture's time. Where each body is, and its colour, is a row of a texture.

const TEXELS = 4; // of a row: three rows of a placement, and a colour

const PLACED = `invariant gl_Position;
  attribute float body;
  uniform highp sampler2D bodies;
  vec4 texel(float k) { return texture2D(bodies, vec2((k + 0.5) / 4.0, body)); }
  vec3 placed(vec4 v) { return vec3(dot(texel(0.0), v), dot(texel(1.0), v), dot(texel(2.0), v)); }
  `;

export class Bodies {
  // The first `count` of these meshes, below `parent`, by each of these materials in this order.
  constructor(parent, meshes, count, materials) {
    const T = MeshCat.THREE;
    this.numbers = new Float32Array(4 * TEXELS * meshes.length);
    this.texture = new T.DataTexture(
      this.numbers,
      TEXELS,
      meshes.length,
      T.RGBAFormat,
      T.FloatType,
    );
    const { attributes, index, ends } = joinedGeometry(meshes);
    const geometry = Object.assign(new T.BufferGeometry(), { attributes, index });
    geometry.setDrawRange(0, ends[count]);
    this.meshes = materials.map((material) => {
      const mesh = new T.Mesh(geometry, this.placing(material));
      mesh.frustumCulled = false;
      parent.add(mesh);
      return mesh;
    });
  }

  // Have a material draw each body where it is, and in its colour if it has colours of vertices.
  placing(material) {
    material.onBeforeCompile = (shader) => {
      shader.uniforms.bodies = { value: this.texture };
      shader.vertexShader = `${PLACED}${shader.vertexShader}`
        .replace("#include <color_vertex>", "#ifdef USE_COLOR\nvColor = texel(3.0).rgb;\n#endif")
        .replace("#include <beginnormal_vertex>", "vec3 objectNormal = placed(vec4(normal, 0.0));")
        .replace("#include <begin_vertex>", "vec3 transformed = placed(vec4(position, 1.0));");
    };
    return material;
  }

  // Draw each body where its place is, in its colour; a body without a place is not drawn.
  draw(places, color) {
    const { numbers } = this;
    numbers.fill(0);
    places.forEach((place, k) => {
      if (!place) return;
      const at = 4 * TEXELS * k;
      const { elements } = place.matrix;
      for (let i = 0; i < 12; i++) numbers[at + i] = elements[(i >> 2) + 4 * (i & 3)];
      if (color) color(place).toArray(numbers, at + 12);
    });
    for (const mesh of this.meshes) mesh.visible = places.some(Boolean);
    this.texture.needsUpdate = true;
  }
}

const joinedBefore = new Map(); // the same bodies stand in each pane

// The geometries of these meshes as one, as they lie below their places; `ends`: how many numbers
// of its index the first meshes take.
function joinedGeometry(meshes) {
  const T = MeshCat.THREE;
  const key = meshes.map(({ geometry, scale }) => [geometry.uuid, ...scale.toArray()]).join();
  if (joinedBefore.has(key)) return joinedBefore.get(key);
  const count = meshes.reduce((sum, { geometry }) => sum + geometry.attributes.position.count, 0);
  const [position, normal, body] = [3, 3, 1].map((size) => new Float32Array(size * count));
  const index = [];
  const ends = [0];
  const v = new T.Vector3();
  let first = 0;
  meshes.forEach(({ geometry, matrix }, k) => {
    const { attributes, index: corners } = geometry;
    const turn = new T.Matrix3().getNormalMatrix(matrix);
    const end = first + attributes.position.count;
    for (let i = first; i < end; i++) {
      v.fromBufferAttribute(attributes.position, i - first).applyMatrix4(matrix);
      v.toArray(position, 3 * i);
      v.fromBufferAttribute(attributes.normal, i - first).applyNormalMatrix(turn);
      v.toArray(normal, 3 * i);
    }
    body.fill((k + 0.5) / meshes.length, first, end);
    // a mirrored triangle is seen from its other side
    const [b, c] = matrix.determinant() < 0 ? [2, 1] : [1, 2];
    for (let i = 0; i < corners.count; i += 3)
      for (const corner of [0, b, c]) index.push(first + corners.getX(i + corner));
    ends.push(index.length);
    first = end;
  });
  const joined = new T.BufferGeometry().setIndex(index);
  for (const [name, numbers] of Object.entries({ position, normal, body }))
    joined.setAttribute(name, new T.BufferAttribute(numbers, numbers.length / count));
  joinedBefore.set(key, Object.assign(joined, { ends }));
  return joined;
}
