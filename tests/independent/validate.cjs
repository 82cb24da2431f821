// Validates glTF files, with the files that they name. Standard input: a JSON array of paths.
// Standard output: a JSON array with an object for each: `errors` (their number), `first` (the first
// error), `codes` (of all messages) and `triangles` (of all meshes); or `refused`, if the validator
// does not know the format or fails.
// usage: node validate.cjs <node_modules>

const fs = require("fs");
const path = require("path");
const validator = require(path.join(path.resolve(process.argv[2]), "gltf-validator"));

// The validator throws outside of its promise for some damaged images.
let failed = () => {};
process.on("uncaughtException", (error) => failed({ refused: `the validator failed: ${error}` }));

async function validate(file) {
  const externalResourceFunction = async (uri) =>
    new Uint8Array(fs.readFileSync(path.resolve(path.dirname(file), decodeURIComponent(uri))));
  const options = { uri: path.basename(file), maxIssues: 0, writeTimestamp: false, externalResourceFunction };
  try {
    const report = await validator.validateBytes(new Uint8Array(fs.readFileSync(file)), options);
    const first = report.issues.messages.find((message) => message.severity === 0);
    return {
      errors: report.issues.numErrors,
      first: first ? `${first.code} ${first.pointer ?? ""}`.trim() : null,
      codes: [...new Set(report.issues.messages.map((message) => message.code))],
      triangles: report.info?.totalTriangleCount ?? 0,
    };
  } catch (error) {
    return { refused: String(error) };
  }
}

(async () => {
  const reports = [];
  for (const file of JSON.parse(fs.readFileSync(0, "utf8"))) {
    const failure = new Promise((resolve) => (failed = resolve));
    reports.push(await Promise.race([validate(file), failure]));
  }
  process.stdout.write(JSON.stringify(reports));
})();
