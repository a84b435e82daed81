"""The Spack package; a repository of Spack has it as packages/bromwich/package.py."""

from spack.package import *


class Bromwich(CMakePackage, CudaPackage):
    """Simulates nonsmooth dynamics stated as linear complementarity systems: circuits with ideal diodes, structures with
    contact, membranes, obstacle problems, relays."""

    maintainers("bromwich")
    license("BSD-3-Clause")

    version("main", branch="main")

    variant("hdf5", default=True, description="Results and checkpoints in HDF5")
    variant("mpi", default=False, description="Time divided among ranks of MPI")

    depends_on("c", type="build")
    depends_on("cxx", type="build")
    depends_on("cmake@3.25:", type="build")
    depends_on("ninja", type="build")
    depends_on("eigen@3.4:")
    depends_on("fftw-api@3")
    depends_on("cli11", type="build")
    depends_on("nlohmann-json", type="build")
    depends_on("fmt@9:")
    depends_on("spdlog", type="build")
    depends_on("tomlplusplus", type="build")
    depends_on("muparser")
    depends_on("zlib-api")
    depends_on("hdf5@1.10.7: +hl", when="+hdf5")
    depends_on("mpi", when="+mpi")
    depends_on("cuda@12.3:", when="+cuda")

    generator("ninja")

    def cmake_args(self):
        args = [
            self.define("CMAKE_UNITY_BUILD", True),
            self.define("BROMWICH_CUDA", "ON" if "+cuda" in self.spec else "OFF"),
            self.define("BROMWICH_MPI", "ON" if "+mpi" in self.spec else "OFF"),
            self.define("BROMWICH_NATIVE", False),  # the compiler wrapper names the target
            self.define("BROMWICH_STUDIES", False),
            self.define("BUILD_TESTING", False),
        ]
        if "+cuda" in self.spec and "none" not in self.spec.variants["cuda_arch"].value:
            args.append(self.define("CMAKE_CUDA_ARCHITECTURES", self.spec.variants["cuda_arch"].value))
        return args
