// The outline of a body: the body once more, a little larger on the screen, in one colour.

export const OUTLINE = 1.6; // px, of a ghost, at least
const OUTLINE_SHARE = 1 / 500; // of the height of a pane, at least

// Size of a pixel, in parts of half a pane: of width and of height.
export const PIXEL = { value: null };

// A material that draws a body a little larger on the screen, for an outline.
export function outlined(options) {
  const T = MeshCat.THREE;
  PIXEL.value = PIXEL.value || new T.Vector2(0.002, 0.002);
  return new T.ShaderMaterial({
    ...options,
    side: T.DoubleSide,
    blending: T.CustomBlending,
    uniforms: {
      color: { value: new T.Color() },
      pixel: PIXEL,
      least: { value: OUTLINE },
      share: { value: OUTLINE_SHARE },
    },
    vertexShader: `uniform vec2 pixel; uniform float least; uniform float share;
      void main() {
        float wide = max(least, 2.0 * share / pixel.y);
        #include <begin_vertex>
        #include <beginnormal_vertex>
        gl_Position = projectionMatrix * modelViewMatrix * vec4(transformed, 1.0);
        vec2 way = (projectionMatrix * vec4(normalMatrix * objectNormal, 0.0)).xy / pixel;
        gl_Position.xy += wide * gl_Position.w * pixel * way / max(length(way), 1e-9);
      }`,
    fragmentShader: "uniform vec3 color; void main() { gl_FragColor = vec4(color, 0.75); }",
  });
}

// A body's surface whose normals agree where faces meet, so that an outline has no gaps; made once.
export function hull(geometry) {
  if (geometry.hull) return geometry.hull;
  const T = MeshCat.THREE;
  const { position, normal } = geometry.attributes;
  const keys = Array.from({ length: position.count }, (_, i) =>
    [position.getX(i), position.getY(i), position.getZ(i)].map((v) => Math.round(1e5 * v)).join(),
  );
  const sums = new Map(keys.map((key) => [key, new T.Vector3()]));
  const one = new T.Vector3();
  keys.forEach((key, i) => sums.get(key).add(one.fromBufferAttribute(normal, i)));
  const outward = keys.flatMap((key) => sums.get(key).toArray());
  geometry.hull = new T.BufferGeometry()
    .setAttribute("position", position)
    .setAttribute("normal", new T.Float32BufferAttribute(outward, 3))
    .setIndex(geometry.index);
  return geometry.hull;
}
