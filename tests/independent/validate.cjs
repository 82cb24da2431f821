// Validates glTF files, with the files that they name. Standard input: a JSON array of paths.
// Standard output: a JSON array with an object for each: `errors` (their number), `first` (the first
// error) and `triangles` (of all meshes); or `refused`, if the validator does not know the format.
// usage: node validate.cjs <node_modules>

const fs = require("fs");
const path = require("path");
const validator = require(path.join(path.resolve(process.argv[2]), "gltf-validator"));

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
      triangles: report.info?.totalTriangleCount ?? 0,
    };
  } catch (error) {
    return { refused: String(error) };
  }
}

(async () => {
  const reports = [];
  for (const file of JSON.parse(fs.readFileSync(0, "utf8"))) reports.push(await validate(file));
  process.stdout.write(JSON.stringify(reports));
})();
