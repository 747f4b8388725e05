// The page's scripts: npx eslint repctl_pin/show/page/assets/scripts
const browser = [
  "window",
  "document",
  "location",
  "performance",
  "MeshCat",
  "atob",
  "Blob",
  "Response",
  "TextDecoder",
  "DecompressionStream",
  "ResizeObserver",
  "requestAnimationFrame",
  "getComputedStyle",
  "setTimeout",
  "WebSocket",
  "cancelAnimationFrame",
  "navigator",
];

export default [
  {
    files: ["repctl_pin/show/page/assets/scripts/**/*.js"],
    languageOptions: {
      ecmaVersion: 2022,
      sourceType: "module",
      globals: Object.fromEntries(browser.map((name) => [name, "readonly"])),
    },
    rules: {
      "no-undef": "error",
      "no-unused-vars": "error",
      "prefer-const": "error",
      "no-var": "error",
      eqeqeq: "error",
      "no-shadow": "error",
      "no-unreachable": "error",
      "no-dupe-keys": "error",
      "no-redeclare": "error",
      "no-implicit-globals": "error",
    },
  },
];
